"""``make endurance``: half an hour of online learning; does memory stay flat, and what does the trainer itself take?

    growth   = (last quarter's median of resident memory) / (second quarter's) - 1
    overhead = 1 - (seconds in collecting, learning, measuring, simulating, fitting, judging) / (seconds in all)

The run is Pendulum's with short outer steps, in a folder of its own that it saves to, as every recipe does. What a run
keeps of each outer step (a policy, a real trajectory, a record) is a part of the growth.

    python -m recipes.studies.endurance [--minutes 5]       -> docs/results/endurance.json
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from envs.pendulum import Pendulum, PendulumTask
from onlinebayes.experiments import hidden_truth, status
from onlinebayes.inference import BoxUniform, fit, residual_estimator
from onlinebayes.objectives import SACSettings, sac
from onlinebayes.runs import ResultTable, RunFolder, seed_everything
from onlinebayes.trainers import OnlineState, OnlineTrainer, Problem, Schedule, Sizes, online_trainer, run_in_folder
from recipes import pendulum
from recipes.studies.jobs import finished, printed_by

GROWTH, OVERHEAD, STEPS = 0.02, 0.05, 10_000


@dataclass(frozen=True)
class Study:
    """Options of the study."""

    minutes: float = 30.0
    """until it is stopped"""
    seed: int = 1
    """of the truth, networks, worlds and draws"""
    results: Path = Path("docs/results")
    """folder of the table"""


class Over(Exception):
    """The time is over."""


def build(seed: int) -> tuple[Problem, OnlineTrainer]:
    """Pendulum with outer steps of some seconds, more of them than there is time for."""
    problem = Problem(Pendulum(pendulum.SPACE), PendulumTask(), BoxUniform(pendulum.SPACE), 0.01 * pendulum.RANGE)
    truth = hidden_truth(pendulum.SPACE, seed, {"length": 1.0, "mass": 1.0})
    train = partial(fit, epochs=8, batch_size=50, learning_rate=4e-3)
    trainer = online_trainer(
        problem,
        sac(*problem.specs, SACSettings()),
        estimator=residual_estimator(problem.simulator, problem.task, state=pendulum.state, train=train),
        real=problem.hidden(truth, seed + 2000),
        schedule=Schedule(STEPS, 8, real_steps=50),
        sizes=Sizes(worlds=64, batch_steps=16, simulations=200, groups=64),
        seed=seed,
    )
    return problem, trainer


def main(study: Study) -> int:
    """Run, look at the memory after each step, print the table."""
    seed_everything(study.seed)
    problem, trainer = build(study.seed)
    memory: list[float] = []
    worked, begin = 0.0, time.monotonic()

    def watch(state: OnlineState) -> None:
        nonlocal worked
        memory.append(resident())
        worked += sum(state.records[-1].seconds.values())
        if time.monotonic() - begin > 60 * study.minutes:
            raise Over

    with tempfile.TemporaryDirectory() as place, RunFolder(Path(place) / "run", "endurance", settings={}) as folder:
        try:
            run_in_folder(trainer, problem.prior, folder, watchers=(watch,))
        except Over:
            took = time.monotonic() - begin
    table = ResultTable("endurance", printed_by("endurance", study), [study.seed])
    quarter = max(1, len(memory) // 4)
    early, late = statistics.median(memory[quarter : 2 * quarter]), statistics.median(memory[-quarter:])
    growth, overhead = late / early - 1, 1 - worked / took
    table.add("outer steps", len(memory), spread=f"in {took / 60:.0f} min")
    table.add("resident memory, last quarter", late / 2**20, unit="MiB")
    table.add("its growth since the second quarter", growth, goal=f"< {GROWTH:g}", holds=growth < GROWTH)
    table.add("overhead of trainer and saving", overhead, goal=f"< {OVERHEAD:g}", holds=overhead < OVERHEAD)
    return finished(table, study.results)


def resident() -> float:
    """Bytes of this process in memory (Linux)."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return float(pages * 4096)


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
