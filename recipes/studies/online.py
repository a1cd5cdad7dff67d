"""``make online``: what online learning is worth, beside a posterior first, the prior alone, and an oracle.

    share_k = (return after k frames - random policy's) / (oracle's at the end - random policy's)

Frames are all that were simulated, for the policy and for the belief. Plain CartPole gives 500 to every kind of run, so
nothing is asked of it. Every run is a recipe's own run in a folder of its own, so that the study goes on where it was
stopped. The truths are points 2 ... 6 of a Sobol sequence over the prior; every policy is judged on the hidden system.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from onlinebayes.experiments import STOPPED, Kind, Run, Settings, run, settle, status
from onlinebayes.runs import Progress, ResultTable
from recipes import acrobot, cartpole, pendulum

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
    processes: int = 2
    """at once"""


@dataclass(frozen=True)
class Curve:
    """Return and all simulated frames after each policy step of a run, and the belief's last word on the truth."""

    frames: tuple[int, ...]
    returns: tuple[float, ...]
    density: float


def main(study: Study) -> int:
    """Run what is missing, print the table."""
    jobs = [(task, kind, seed) for task in study.tasks for seed in study.seeds for kind in KINDS]
    todo = [job for job in jobs if not _log(study, *job).with_name("finished").exists()]
    pool = ProcessPoolExecutor(study.processes, mp_context=get_context("spawn"))
    try:
        with Progress("online", len(jobs)) as progress:
            futures = [pool.submit(_run, study.out, *job) for job in todo]
            for done, future in enumerate(as_completed(futures), len(jobs) - len(todo) + 1):
                future.result()
                progress.update(done, f"runs lie in {study.out}")
    except KeyboardInterrupt:
        print(f"stopped; the runs in {study.out} are kept, and the same command goes on from there")
        return STOPPED
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    table = tabulate(study)
    print(table.to_markdown())
    print(f"written: {table.write()}")
    return 0 if table.holds else 1


def tabulate(study: Study) -> ResultTable:
    """Shares of the oracle's return and the frames that they took, medians over the seeds."""
    table = ResultTable("online", "make online", study.seeds)
    for task in study.tasks:
        found = {(kind, seed): _curve(_log(study, task, kind, seed)) for kind in KINDS for seed in study.seeds}
        lowest = {seed: _untrained(task, seed) for seed in study.seeds}
        shares = {
            key: tuple((r - lowest[key[1]]) / (found["oracle", key[1]].returns[-1] - lowest[key[1]]) for r in c.returns)
            for key, c in found.items()
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


def _curve(log: Path) -> Curve:
    with log.open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if int(row["frames"])]
    return Curve(
        tuple(int(row["frames"]) + int(row["simulated"]) for row in rows),
        tuple(float(row["figure/return"]) for row in rows),
        float(rows[-1]["figure/log density of the truth"]),
    )


def _log(study: Study, task: str, kind: str, seed: int) -> Path:
    return Path(study.out) / f"{task}-{kind}-{seed}" / "log.csv"


def _run(out: str, task: str, kind: Kind, seed: int) -> None:
    settle()
    run(task, BUILD[task], Settings(seed=seed, kind=kind, out=out))


def _untrained(task: str, seed: int) -> float:
    """Return of the policy before its first step, which is as good as random."""
    settle()
    made = BUILD[task](Settings(seed=seed))
    return made.problem.score(made.trainer.objective.policy, made.truth)


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
