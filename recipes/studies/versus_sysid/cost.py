"""The same unknowns fitted to the same windows from the same values: criticism's fit against ``mujoco.sysid``'s.

    min over x in bounds and starts s_w of sum over windows |(measured - simulated(x, s_w)) / noise|^2

Each start's 2 J numbers are a parameter of sysid's. Its differences are dense: a column for each number of each start,
all windows in one rollout of every column (see :mod:`.sysid`), where ours moves all windows' starts at once and solves
for each apart (`onlinebayes.identification.fitting.rows`).

Both on one thread, one after the other, residuals in sensor noise (ours weighs signals and times by the share of their
error). Ours stops where a step promises less than .002 nats of the score; sysid's clock stops at the first iterate
whose objective is within as much of its last one, e^.004, though it goes on.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from mujoco import sysid
from numpy import ndarray

from onlinebayes.identification import SETTLED, fit
from onlinebayes.runs import processor_time
from recipes.studies.versus_sysid.sysid import Problem
from recipes.studies.versus_sysid.sysid_parameters import problem_parameters
from recipes.studies.versus_sysid.task import Task

REACH = 100.0  # how far a start may move [spread of the measured starts]: no bound is in its way

Residual = Callable[[ndarray, sysid.ParameterDict], tuple[list[ndarray], list[Any], list[Any]]]


def seconds(task: Task) -> tuple[float, float]:
    """Processor time of ours and of sysid, from the nominal values [s]."""
    windows, nominal = task.fit_windows, task.simulator.parameters.clamp(task.simulator.nominal)
    began = processor_time()
    fit(task.simulator, windows, nominal)
    ours = processor_time() - began
    return ours, _to_tolerance(*with_free_starts(own_problem(task)))


def own_problem(task: Task) -> Problem:
    """The problem's own parameters, from the nominal ones."""
    return Problem.of(task, problem_parameters(task, task.simulator.parameters.clamp(task.simulator.nominal)))


def with_free_starts(problem: Problem) -> tuple[sysid.ParameterDict, Residual]:
    """The same problem with the starts, window by window, behind its parameters, at their smoothed values."""
    windows, own = problem.task.fit_windows, len(problem.freed)
    parameters, start = problem.parameters, windows.start.numpy()
    far = REACH * (np.ptp(start, axis=0) + 1)
    for window, row in enumerate(start):
        parameters.add(sysid.Parameter(f"start{window}", row, row - far, row + far))

    def column(x: ndarray) -> ndarray:
        moved = torch.from_numpy(np.ascontiguousarray(x[own:].reshape(start.shape)))
        return problem.weighed(x[:own], replace(windows, start=moved), problem.parameters)

    def residual(x: ndarray, params: sysid.ParameterDict) -> tuple[list[ndarray], list[Any], list[Any]]:
        del params
        columns = [column(values) for values in x.reshape(len(x), -1).T]
        return [np.stack(columns, 1) if x.ndim > 1 else columns[0]], [], []

    return parameters, residual


def _to_tolerance(parameters: sysid.ParameterDict, residual: Residual) -> float:
    """Processor time until sysid's objective is within the tolerance of its last [s]."""
    marks: list[tuple[float, float]] = []
    began = processor_time()
    sysid.optimize(
        parameters,
        residual,
        optimizer="mujoco",
        x_scale="jac",
        output=io.StringIO(),
        iter_callback=lambda log: marks.append((processor_time() - began, float(log[-1].objective))),
    )
    # An entry is written after the step that leaves its point: that point was reached when the entry before was.
    near = next(k for k, (_, objective) in enumerate(marks) if objective <= marks[-1][1] * math.exp(2 * SETTLED))
    return marks[max(near - 1, 0)][0]
