"""``make fetch-speed``: steps a second of the Fetch worlds beside Gymnasium-Robotics' own loop, on one thread.

Processor time of random actions: 64 and 256 exact worlds, 256 lean ones, and one environment of Gymnasium-Robotics
after the other, in turns within one process; medians of five turns.

    python -m recipes.studies.fetch_speed       -> docs/results/fetch-speed.json
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from envs.fetch import FetchSimulator, FetchTask, scene
from onlinebayes.experiments import status
from onlinebayes.runs import ResultTable
from onlinebayes.simulators import SimulatorEnv
from recipes.studies.fetch_peer import environments
from recipes.studies.resumable import check_names

TASKS, TURNS, STEPS, EPISODE, LEAST = ("reach", "push", "slide"), 5, 400, 50, 2.0
KINDS = {"64 worlds": (64, False), "256 worlds": (256, False), "256 lean worlds": (256, True)}


@dataclass(frozen=True)
class Study:
    """What to run."""

    tasks: tuple[str, ...] = TASKS
    """which"""
    turns: int = TURNS
    """of each kind"""
    results: Path = Path("docs/results")
    """folder of the table"""


def main(study: Study) -> int:
    """Measure in turns, print the table."""
    check_names(study.tasks, TASKS)
    torch.manual_seed(0)
    table = ResultTable("fetch-speed", "make fetch-speed", (0,))
    with environments() as known:
        for task in study.tasks:
            kinds = {"Gymnasium-Robotics": one_by_one(known[task]())}
            kinds |= {kind: batched(task, *how) for kind, how in KINDS.items()}
            turns = [{kind: measure() for kind, measure in kinds.items()} for _ in range(study.turns)]
            theirs = statistics.median(turn["Gymnasium-Robotics"] for turn in turns)
            table.add(f"{task}: Gymnasium-Robotics", theirs, unit="steps/s")
            for kind in KINDS:
                ratios = [turn[kind] / turn["Gymnasium-Robotics"] for turn in turns]
                table.add_seeds(f"{task}: {kind}", ratios, unit="times", least=LEAST if kind == "64 worlds" else None)
    print(table.to_markdown())
    print(f"written: {table.write(study.results)}")
    return 0 if table.holds else 1


def batched(task: str, worlds: int, lean: bool) -> Callable[[], float]:
    """Measures steps a second of processor time of our worlds, as an environment of TorchRL."""
    place = scene(task, lean)
    env = SimulatorEnv(FetchSimulator(place, worlds=worlds, threads=1), FetchTask(place))

    def measure() -> float:
        begun = time.process_time()
        env.rollout(EPISODE, break_when_any_done=False)
        return worlds * EPISODE / (time.process_time() - begun)

    return measure


def one_by_one(env: object) -> Callable[[], float]:
    """The same of one of theirs."""
    actions = np.random.default_rng(0).uniform(-1, 1, (STEPS, 4))

    def measure() -> float:
        env.reset(seed=0)  # type: ignore[attr-defined]
        begun = time.process_time()
        for k, action in enumerate(actions):
            if k % EPISODE == EPISODE - 1:
                env.reset()  # type: ignore[attr-defined]
            env.step(action)  # type: ignore[attr-defined]
        return STEPS / (time.process_time() - begun)

    return measure


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
