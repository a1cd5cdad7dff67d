"""``make wall-clock``: from nothing to a solved task and a posterior, beside stable-baselines3 with sbi between.

| step        | ours (the recipe)                         | theirs                                              |
|-------------|-------------------------------------------|-----------------------------------------------------|
| policy      | PPO (CartPole), SAC (Pendulum), 64 worlds | PPO, SAC with the zoo's settings, its vectorised envs |
| posterior   | mixture density network, every outer step | sbi's NPE with the same kind of density, once        |
| then policy | in worlds of the belief                   | in worlds of the posterior, until solved            |

Both learn first in worlds of the prior, both measure the same hidden system through the same sensors, both are asked
after each piece of training how the deterministic policy does there. That question is not timed, and imports are not.
A task is solved at 475 (CartPole) and -200 (Pendulum). Theirs infers after a quarter of the zoo's frames, or as soon as
its policy is good enough. The two take turns, seed by seed, one thread each.
"""

from __future__ import annotations

import contextlib
import json
import math
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from onlinebayes.experiments import Run, Settings, status
from onlinebayes.runs import Progress, ResultTable, seed_everything, write_atomic
from onlinebayes.trainers import OnlineState
from recipes import cartpole, pendulum

BUILD: dict[str, Callable[[Settings], Run]] = {"cartpole": cartpole.build, "pendulum": pendulum.build}
SOLVED = {"cartpole": 475.0, "pendulum": -200.0}
GOAL = 5.0


@dataclass(frozen=True)
class Study:
    """All runs and the table."""

    tasks: tuple[str, ...] = tuple(BUILD)
    """which recipes"""
    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    """of networks, worlds, draws, and of the hidden truth as in the recipes"""
    out: str = "out/wall_clock"
    """finished runs are kept here"""


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


def ours(task: str, seed: int) -> Outcome:
    """The recipe, until an outer step ends with the task solved."""
    seed_everything(seed)
    watch = Stopwatch()
    made = BUILD[task](Settings(seed=seed))
    state, found = OnlineState.begin(made.problem.prior), Outcome(math.inf, -math.inf, -math.inf)

    def judge(state: OnlineState) -> None:
        nonlocal found
        score = watch.aside(lambda: made.judge(state)["return"])
        found = Outcome(math.inf, score, float(state.belief.log_prob(made.truth)))
        if score >= SOLVED[task]:
            found = Outcome(watch.seconds, score, found.density)
            raise Solved

    with contextlib.suppress(Solved):
        made.trainer.run(state, on_step=judge)
    return found


def main(study: Study) -> int:
    """Run what is missing, print the table."""
    from recipes.studies.wall_clock_peers import theirs  # the peers are an extra

    sides = {"ours": ours, "theirs": theirs}
    jobs = [(task, seed, side) for task in study.tasks for seed in study.seeds for side in sides]
    found: dict[tuple[str, int, str], Outcome] = {}
    with Progress("wall-clock", len(jobs)) as progress:
        for done, (task, seed, side) in enumerate(jobs):
            file = Path(study.out) / f"{task}-{side}-{seed}.json"
            if not file.exists():
                progress.update(done, f"{task}, seed {seed}, {side}")
                write_atomic(file, json.dumps(asdict(sides[side](task, seed))) + "\n")
            found[task, seed, side] = Outcome(**json.loads(file.read_text("utf-8")))
    table = tabulate(study, found)
    print(table.to_markdown())
    print(f"written: {table.write()}")
    return 0 if table.holds else 1


def tabulate(study: Study, found: dict[tuple[str, int, str], Outcome]) -> ResultTable:
    """Medians over the seeds, and the ratios seed by seed."""
    table = ResultTable("wall-clock", "make wall-clock", study.seeds)
    for task in study.tasks:
        for side in ("ours", "theirs"):
            of = [found[task, seed, side] for seed in study.seeds]
            table.add_seeds(f"{task}, {side}: until solved with a posterior", [o.seconds for o in of], unit="s")
            table.add_seeds(f"{task}, {side}: return", [o.score for o in of])
            table.add_seeds(f"{task}, {side}: log density of the truth", [o.density for o in of], unit="nats")
        ratios = [found[task, s, "theirs"].seconds / found[task, s, "ours"].seconds for s in study.seeds]
        table.add_seeds(f"{task}: theirs over ours", ratios, least=GOAL)
    return table


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
