"""The same parameters fitted to the same windows from the same start: criticism's fit against ``mujoco.sysid``'s.

Both run on one thread, one after the other. Criticism projects the start of every window out, which sysid takes as
measured: the harder problem. It stops when a step promises less than 1e-5 of the objective; sysid's clock stops at the
first iterate whose objective is within 1e-5 of its last one, though it goes on after that.
"""

from __future__ import annotations

import io
import time

import torch
from mujoco import sysid

from onlinebayes.criticism.fit import TOLERANCE, fit
from recipes.studies.peers.sysid import Problem
from recipes.studies.peers.sysid_parameters import Freed, setter
from recipes.studies.peers.task import Task


def seconds(task: Task) -> tuple[float, float]:
    """Processor time of ours and of sysid's fit of the problem's own parameters from the nominal ones [s]."""
    task.fit_windows, task.noise  # noqa: B018  (cut beforehand: both need them)
    began = time.process_time()
    fit(task.simulator, task.fit_windows, task.simulator.nominal)
    return time.process_time() - began, _sysid(task)


def _sysid(task: Task) -> float:
    marks: list[tuple[float, float]] = []
    nominal = task.simulator.parameters.clamp(task.simulator.nominal).tolist()
    freed = [
        Freed(address, bounds.low, bounds.high, value, value, frozenset(), setter(address))
        for (address, bounds), value in zip(task.simulator.parameters.items(), nominal, strict=True)
    ]
    problem = Problem.of(task, freed)
    began = time.process_time()
    sysid.optimize(
        problem.parameters,
        problem.residual,
        optimizer="mujoco",
        x_scale="jac",
        output=io.StringIO(),
        iter_callback=lambda log: marks.append((time.process_time() - began, float(log[-1].objective))),
    )
    last = marks[-1][1]
    # An entry is written after the step that follows its point: the first near the last is one iteration late.
    near = next(k for k, (_, objective) in enumerate(marks) if objective <= last * (1 + TOLERANCE))
    return marks[max(near - 1, 0)][0]


def spread_over(seconds_: torch.Tensor) -> str:
    """Smallest to largest."""
    return f"{float(seconds_.min()):.3g} to {float(seconds_.max()):.3g}"
