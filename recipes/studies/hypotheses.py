"""``make hypotheses``: the new search on measured machines and on blind cases, as far as it is built.

    named   = hidden effects found, nothing else accepted; an own number of the model that is the same law counts as it
    part    = held-out error after / before, in the signal that falls least

Every case is kept in a file of its own, so that a study that was stopped goes on. Seeds below 7400 were looked at.
"""

from __future__ import annotations

import os
import re
import statistics
import sys
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import tyro

from envs.measured import FOLDER
from envs.rigs import RIGS, case
from onlinebayes.cli.problem import Problem, load_problem
from onlinebayes.criticism import Explanation, explain
from onlinebayes.runs import BadInput, Progress, ResultTable, one_torch_thread, write_atomic
from onlinebayes.simulators.mujoco import MujocoSimulator
from recipes.studies.blind_rigs.judging import loaded
from recipes.studies.blind_rigs.names import answer, spelt
from recipes.studies.exits import status
from recipes.studies.json_line import line, parsed

MACHINES = {
    "emps": (FOLDER / "emps" / "problem.toml", "dry_friction@carriage and constant_load@carriage"),
    "quanser_cartpole": ("quanser_cartpole/problem.toml", "constant_load@cart and friction of the pole"),
}


@dataclass(frozen=True)
class Study:
    """What to run."""

    machines: tuple[str, ...] = tuple(MACHINES)
    """measured machines; they need ONLINEBAYES_DATA"""
    effects: int = 3
    """cases of each rig that hide one or two effects"""
    null: int = 2
    """cases of each rig that hide nothing"""
    first: int = 7400
    """seed of the first case"""
    out: str = "out/hypotheses"
    """a file for each finished case goes here"""
    processes: int = 2
    """at once"""


@dataclass(frozen=True)
class Found:
    """What the search made of one case.

    Args:
        name: of the case.
        hidden: what is missing, in the library's names; empty of a null set and of a measured machine.
        additions: what was accepted.
        equals: what cannot be told from it.
        right: whether that is right, as the module says; None of a measured machine.
        part: see the module.
        seconds: of the processor.
        windows: how many of which length [s], integrated how.
    """

    name: str
    hidden: tuple[str, ...]
    additions: tuple[str, ...]
    equals: tuple[str, ...]
    right: bool | None
    part: float
    seconds: float
    windows: str


def main(study: Study) -> int:
    """Run what is missing, print the table."""
    names = [f"machine {name}" for name in study.machines]
    names += [f"{rig} {kind} {study.first + k}" for k, rig, kind in _cases(study)]
    todo = [name for name in names if not _file(study, name).exists()]
    pool = ProcessPoolExecutor(study.processes, mp_context=get_context("spawn"))
    try:
        with Progress("hypotheses", len(names)) as progress:
            for done, found in enumerate(pool.map(work, todo), len(names) - len(todo) + 1):
                write_atomic(_file(study, found.name), line(found))
                progress.update(done, f"{found.name}: {', '.join(found.additions) or 'nothing'}")
    except KeyboardInterrupt:
        print(f"stopped; finished cases are kept in {study.out}, and the same command goes on", file=sys.stderr)
        return 130
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    table = tabulate([read(_file(study, name)) for name in names], study.first)
    print(table.to_markdown())
    print(f"written: {table.write()}")
    return 0


def work(name: str) -> Found:
    """One case, by name."""
    with one_torch_thread():
        first, *rest = name.split()
        if first == "machine":
            return machine(name, rest[0])
        return blind(name, first, rest[0], int(rest[1]))


def machine(name: str, key: str) -> Found:
    """A measured machine."""
    if not (data := os.environ.get("ONLINEBAYES_DATA")):
        raise BadInput("ONLINEBAYES_DATA is not set", "set it to the folder of the measured machines")
    return _found(name, (), *explained(load_problem(Path(data) / str(MACHINES[key][0]))), None)


def blind(name: str, rig: str, kind: str, seed: int) -> Found:
    """A case of the rigs; only after the search its truth is looked at."""
    made = case(rig, kind, seed)
    explanation, seconds = explained(loaded(made))
    hidden = tuple(spelt(key, made.truth) for key in made.hidden)
    answers = [answer(rig, key) for key in hidden]
    accepted = [as_effect(key) for key in explanation.found.hypothesis.keys]
    innocent = [key for key in accepted if not any(one.admits(key) for one in answers)]
    return _found(name, hidden, explanation, seconds, all(one.found(accepted) for one in answers) and not innocent)


def explained(problem: Problem) -> tuple[Explanation, float]:
    """A problem as its file says it, on one thread, and the processor's seconds that it took."""
    began = time.process_time()
    simulator = problem.simulator
    if type(simulator) is MujocoSimulator:
        simulator = MujocoSimulator(simulator.spec, simulator.parameters, threads=1, effects=simulator.effects)
    found = explain(
        simulator, problem.measurement, holdout=problem.holdout, candidates=problem.candidates, scope=problem.scope
    )
    return found, time.process_time() - began


def as_effect(key: str) -> str:
    """The effect that is the same law as an own number of the model; other keys as they are."""
    if found := re.fullmatch(r"body\.(.+)\.ipos\[(\d)\]", key):
        return f"com_offset@{found[1]}.{'xyz'[int(found[2])]}"
    if found := re.fullmatch(r"actuator\.(.+)\.gear\[0\]", key):
        return f"actuator_gain@{found[1]}"
    return key


def tabulate(found: Iterable[Found], first: int) -> ResultTable:
    """Shares of right answers, what the machines gave, and every miss."""
    table, cases = ResultTable("hypotheses", "make hypotheses", [first]), list(found)
    for one in [c for c in cases if c.right is None]:
        table.add(f"{one.name}: found", ", ".join(one.additions) or "nothing", goal=MACHINES[one.name.split()[1]][1])
        table.add(f"{one.name}: held-out error after / before", one.part, spread=one.windows)
        table.add(f"{one.name}: time", one.seconds, unit="CPU s")
    kinds = {
        "nothing hidden: nothing accepted": [c for c in cases if c.right is not None and not c.hidden],
        "one effect hidden: named": [c for c in cases if len(c.hidden) == 1],
        "two effects hidden: both named": [c for c in cases if len(c.hidden) == 2],
    }
    for name, those in ((name, those) for name, those in kinds.items() if those):
        right = sum(bool(one.right) for one in those)
        table.add(name, right / len(those), spread=f"{right} of {len(those)}")
    seconds = [one.seconds for one in cases if one.right is not None]
    if seconds:
        table.add(
            "time of a blind case, median", statistics.median(seconds), spread=f"to {max(seconds):.0f}", unit="CPU s"
        )
    for one in [c for c in cases if c.right is False]:
        equal = f"; equal: {', '.join(one.equals)}" if one.equals else ""
        table.add(
            f"MISS {one.name}",
            ", ".join(one.hidden) or "nothing",
            spread=f"found {', '.join(one.additions) or 'nothing'}{equal}",
        )
    return table


def read(file: Path) -> Found:
    """A case that was kept."""
    return parsed(Found, file.read_text("utf-8"), lambda raw: "additions" in raw, "case of this study")


def _found(name: str, hidden: tuple[str, ...], explanation: Explanation, seconds: float, right: bool | None) -> Found:
    parts = [explanation.after[signal] / before for signal, before in explanation.before.items() if before > 0]
    windows, step = explanation.windows, explanation.evaluator.discretisation.values
    return Found(
        name,
        hidden,
        explanation.found.hypothesis.keys,
        tuple(other.key for one in explanation.rounds for other in one.equals),
        right,
        max(parts, default=float("nan")),
        seconds,
        f"{windows.count} windows of {windows.horizon:.2g} s, {step.method} steps of {step.timestep:g} s",
    )


def _cases(study: Study) -> Iterator[tuple[int, str, str]]:
    for k in range(max(study.effects, study.null)):
        for rig in RIGS:
            if k < study.effects:
                yield k, rig, "effect"
            if k < study.null:
                yield k, rig, "null"


def _file(study: Study, name: str) -> Path:
    return Path(study.out) / f"{name.replace(' ', '-')}.json"


if __name__ == "__main__":
    sys.exit(status("hypotheses", lambda: main(tyro.cli(Study, description=__doc__))))
