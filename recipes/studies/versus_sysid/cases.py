"""Cases of the comparison, and their right answers: 50 blind ones, 10 of them with nothing hidden, and EMPS.

Interleaved over the rigs, so that a part of them is a sample. Of each five cases of a rig one hides nothing.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import final

from envs.measured import FOLDER
from envs.rigs import case as rig_case
from onlinebayes.identification import in_step, split
from onlinebayes.problems import load_problem
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco import MujocoSimulator
from recipes.studies.blind_rigs.judging import loaded
from recipes.studies.blind_rigs.names import Answer, answer, spelt
from recipes.studies.blind_rigs.plan import Job
from recipes.studies.measured_sets import emps as measured_emps
from recipes.studies.versus_sysid.task import Task

EMPS = "emps"
RIGS = ("thrown_ball", "swing", "position_servo", "slide_drive", "cart_pole")
EVERY = 5
FIRST = 2000
"""Seed of a rig's first case of a kind."""
PUBLISHED = measured_emps.WANTED
"""Laws of the benchmark's own reference model of EMPS beside mass and viscous friction."""


@final
@dataclass(frozen=True)
class Case:
    """A task with its answers.

    Args:
        task: as the methods get it.
        hidden: the right names, for the reader.
        answers: what counts as finding each of them.
    """

    task: Task
    hidden: tuple[str, ...]
    answers: tuple[Answer, ...]


def jobs(count: int, measured: bool) -> list[Job]:
    """The first ``count`` blind cases, after EMPS where its data are at hand."""
    found = [Job(EMPS, "measured", 0)] if measured else []
    for k in range(count):
        rig, turn = RIGS[k % len(RIGS)], k // len(RIGS)
        null = turn % EVERY == EVERY - 1
        found.append(Job(rig, "null" if null else "effect", FIRST + (turn // EVERY if null else turn)))
    return found


def make(job: Job) -> Case:
    """Make the case of a job (seconds).

    Args:
        job: which.

    Raises:
        BadInput: EMPS without its data.
    """
    if job.rig == EMPS:
        return _emps()
    made = rig_case(job.rig, job.kind, job.seed, last=False)
    problem = loaded(made)
    simulator = in_step(problem.simulator, split(problem.measurement, problem.holdout)[0])
    assert isinstance(simulator, MujocoSimulator)
    assert problem.holdout is not None
    hidden = tuple(spelt(key, made.truth) for key in made.hidden)
    task = Task(job.name, simulator, problem.measurement, problem.holdout, problem.selection)
    return Case(task, hidden, tuple(answer(job.rig, key) for key in hidden))


def _emps() -> Case:
    if not os.environ.get("ONLINEBAYES_DATA"):
        raise BadInput("ONLINEBAYES_DATA is not set", "set it to the folder that holds emps/emps.csv")
    problem = load_problem(FOLDER / "emps" / "problem.toml")
    assert isinstance(problem.simulator, MujocoSimulator)
    assert problem.holdout is not None
    simulator = MujocoSimulator(problem.simulator.spec, problem.simulator.parameters, threads=1)
    task = Task(EMPS, simulator, problem.measurement, problem.holdout, problem.selection)
    return Case(task, PUBLISHED, tuple(_plain(key, "asymmetric_friction@carriage") for key in PUBLISHED))


def _plain(key: str, *equals: str) -> Answer:
    """The name itself; names of what is the same law counts, too."""
    return Answer(frozenset({key, *equals}), (), frozenset())
