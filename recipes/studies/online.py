"""``make online``: what online learning is worth, beside a posterior first, the prior alone, and an oracle.

    share_k = (return after k frames - random policy's) / (oracle's at the end - random policy's)

Frames are all that were simulated, for the policy and for the belief. Plain CartPole gives 500 to every kind of run, so
nothing is asked of it. Every run is a recipe's own run in a folder of its own, so that the study goes on where it was
stopped. The truths are points 2 ... 6 of a Sobol sequence over the prior; every policy is judged on the hidden system.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from onlinebayes.experiments import STOPPED, Kind, Run, Settings, place_of, run, settle, status
from onlinebayes.runs import ResultTable, seed_everything
from recipes import acrobot, cartpole, pendulum
from recipes.studies.jobs import each_kept_or_done, finished, printed_by, record

KINDS: tuple[Kind, ...] = ("online", "posterior-first", "prior", "oracle")
BUILD: dict[str, Callable[[Settings], Run]] = {
    "pendulum": pendulum.build,
    "acrobot": acrobot.build,
    "cartpole_motor": partial(cartpole.build, space=cartpole.MOTOR),
    "cartpole": cartpole.build,
}
SHARE = 0.95  # of the oracle's return, which counts as solved
HALF = 0.5  # of the frames of a posterior first


@dataclass(frozen=True)
class Study:
    """All runs and the table."""

    tasks: tuple[str, ...] = tuple(BUILD)
    """which recipes"""
    seeds: tuple[int, ...] = (1, 2, 3, 4, 5)
    """which truths"""
    out: str = "out/online"
    """the runs' folders go here; what is finished is not run again"""
    results: Path = Path("docs/results")
    """folder of the table"""
    processes: int = 2
    """at once"""


@dataclass(frozen=True)
class Curve:
    """Return and all simulated frames after each policy step of a run, and the belief's last word on the truth."""

    frames: tuple[int, ...]
    returns: tuple[float, ...]
    density: float
    untrained: float
    """return of the policy before its first step, which is as good as random"""


def main(study: Study) -> int:
    """Run what is missing, print the table."""
    wanted = [(task, kind, seed) for task in study.tasks for seed in study.seeds for kind in KINDS]
    jobs = {job: partial(learnt, study.out, *job) for job in wanted}
    folder = Path(study.out) / "curves"
    found = each_kept_or_done("online", folder, jobs, lambda job: "-".join(map(str, job)), processes=study.processes)
    curves = {job: record(Curve, result) for job, result in found.items()}
    return finished(tabulate(study, curves), study.results, found)


def tabulate(study: Study, curves: Mapping[tuple[str, Kind, int], Curve]) -> ResultTable:
    """Shares of the oracle's return and the frames that they took, medians over the seeds."""
    table = ResultTable("online", printed_by("online", study), study.seeds)
    for task in study.tasks:
        found = {(kind, seed): curves[task, kind, seed] for kind in KINDS for seed in study.seeds}
        oracle = {seed: found["oracle", seed] for seed in study.seeds}
        lowest = {seed: curve.untrained for seed, curve in oracle.items()}
        shares = {
            (kind, s): tuple((r - lowest[s]) / (oracle[s].returns[-1] - lowest[s]) for r in curve.returns)
            for (kind, s), curve in found.items()
        }
        for kind in KINDS:
            table.add_seeds(f"{task}, {kind}: return", [found[kind, s].returns[-1] for s in study.seeds])
        for kind in KINDS[:3]:
            last = [shares[kind, s][-1] for s in study.seeds]
            goal = SHARE if kind == "online" and task != "cartpole" else None
            table.add_seeds(f"{task}, {kind}: share of the oracle's return", last, least=goal)
        frames = {k: [_frames_to(SHARE, found[k, s].frames, shares[k, s]) for s in study.seeds] for k in KINDS[:2]}
        for kind, counts in frames.items():
            table.add_seeds(f"{task}, {kind}: frames to {SHARE:g} of the oracle's return", counts, unit="frames")
        parts = [a / b for a, b in zip(frames["online"], frames["posterior-first"], strict=True)]
        most = HALF if task != "cartpole" else None
        table.add_seeds(f"{task}: online's share of the frames of a posterior first", parts, most=most)
        for kind in KINDS[:2]:
            table.add_seeds(f"{task}, {kind}: log density of the truth", [found[kind, s].density for s in study.seeds])
    return table


def _frames_to(share: float, frames: tuple[int, ...], shares: tuple[float, ...]) -> float:
    """Frames after which the share was reached for good; inf where it was not."""
    reached = float("inf")
    for count, value in zip(reversed(frames), reversed(shares), strict=True):
        if value < share:
            break
        reached = count
    return reached


def learnt(out: str, task: str, kind: Kind, seed: int) -> dict[str, Any]:
    """A run in its own folder, gone on with where it was stopped: the fields of its :class:`Curve`."""
    settle()
    settings = Settings(seed=seed, kind=kind, out=out)
    if not (place_of(task, settings) / "finished").exists() and run(task, BUILD[task], settings) == STOPPED:
        raise KeyboardInterrupt
    with (place_of(task, settings) / "log.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if int(row["frames"])]
    seed_everything(seed)
    made = BUILD[task](settings)
    return {
        "frames": [int(row["frames"]) + int(row["simulated"]) for row in rows],
        "returns": [float(row["figure/return"]) for row in rows],
        "density": float(rows[-1]["figure/log density of the truth"]),
        "untrained": made.problem.score(made.trainer.objective.policy, made.truth),
    }


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
