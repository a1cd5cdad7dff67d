"""``make wall-clock``: CartPole from nothing to solved with a posterior, beside stable-baselines3 with sbi between.

| step        | ours (the recipe)                         | theirs                                               |
|-------------|-------------------------------------------|------------------------------------------------------|
| policy      | PPO, 64 worlds                            | PPO with the zoo's settings, its vectorised envs     |
| posterior   | mixture density network, every outer step | sbi's NPE with the same kind of density, once        |
| then policy | in worlds of the belief                   | in worlds of the posterior, until solved             |

Both learn first in worlds of the prior, both measure the same hidden system through the same sensors, both are asked
after each piece of training how the deterministic policy does there. That question is not timed, and imports are not.
The task is solved at a return of 475. Theirs infers after a quarter of the zoo's frames, or as soon as its policy is
good enough. The two take turns, seed by seed, one thread each.

    python -m recipes.studies.wall_clock [--seeds 0]       -> docs/results/wall-clock.json
"""

from __future__ import annotations

import contextlib
import math
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import torch

from onlinebayes.experiments import Settings, status
from onlinebayes.runs import ResultTable, seed_everything
from onlinebayes.trainers import OnlineState
from recipes import cartpole
from recipes.studies.jobs import Places, each_kept_or_done, finished, printed_by

SOLVED, GOAL = 475.0, 3.0


@dataclass(frozen=True, kw_only=True)
class Study(Places):
    """Options of the study."""

    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    """of networks, worlds, draws, and of the hidden truth as in the recipe"""
    out: str = "out/wall_clock"


@dataclass(frozen=True)
class Outcome:
    """Seconds until solved with a posterior (inf if never), the return then, the truth's log density [nats]."""

    seconds: float
    score: float
    density: float


class Stopwatch:
    """Seconds of work, without what is paused."""

    def __init__(self) -> None:
        self._begin, self._paused = time.perf_counter(), 0.0

    @property
    def seconds(self) -> float:
        """Seconds so far."""
        return time.perf_counter() - self._begin - self._paused

    def aside(self, work: Callable[[], float]) -> float:
        """Do ``work`` without timing it."""
        begin = time.perf_counter()
        result = work()
        self._paused += time.perf_counter() - begin
        return result


class Solved(Exception):
    """Ends a run at the outer step that solves the task."""


def ours(seed: int) -> Outcome:
    """The recipe, until an outer step ends with the task solved."""
    seed_everything(seed)
    watch = Stopwatch()
    made = cartpole.build(Settings(seed=seed))
    state, found = OnlineState.begin(made.problem.prior), Outcome(math.inf, -math.inf, -math.inf)

    def judge(state: OnlineState) -> None:
        nonlocal found
        score = watch.aside(lambda: made.judge(state)["return"])
        found = Outcome(math.inf, score, float(state.belief.log_prob(made.truth)))
        if score >= SOLVED:
            found = Outcome(watch.seconds, score, found.density)
            raise Solved

    with contextlib.suppress(Solved):
        made.trainer.run(state, on_step=judge)
    return found


def main(study: Study) -> int:
    """Run what is missing, print the table."""
    from recipes.studies.wall_clock_peers import theirs  # the peers are an extra

    torch.set_num_threads(1)
    sides: dict[str, Callable[[int], Outcome]] = {"ours": ours, "theirs": theirs}
    jobs = {(seed, side): (lambda s=seed, of=of: asdict(of(s))) for seed in study.seeds for side, of in sides.items()}
    found = each_kept_or_done("wall-clock", study.out, jobs, lambda job: f"{job[1]}-{job[0]}", study.ray_workers)
    table = ResultTable("wall-clock", printed_by("wall-clock", study), study.seeds)
    for side in sides:
        of = [found[seed, side] for seed in study.seeds]
        table.add_seeds(f"{side}: until solved with a posterior", [o["seconds"] for o in of], unit="s")
        table.add_seeds(f"{side}: return", [o["score"] for o in of])
        table.add_seeds(f"{side}: log density of the truth", [o["density"] for o in of], unit="nats")
    ratio = statistics.median(found[s, "theirs"]["seconds"] / found[s, "ours"]["seconds"] for s in study.seeds)
    table.add("theirs over ours, median", ratio, unit="times", goal=f"at least {GOAL:g}", holds=ratio >= GOAL)
    return finished(table, study.results, found)


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
