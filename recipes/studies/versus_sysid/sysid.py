"""Peer (b): ``mujoco.sysid``, every parameter freed at once, by its own bounded least squares.

    min over x in bounds of sum over windows |(measured - simulated(x)) / noise|^2

Each fit window is a sequence from its smoothed start, all rolled out at once (its default of a rollout a sequence
takes several times as long); residuals are in sensor noise (its default divides by the size of the signal, which for
a joint near zero is nothing). A parameter that ends 3 sd from its nominal value is claimed, sd by its own
``calculate_intervals``.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import mujoco
import numpy as np
import torch
from jaxtyping import Float
from mujoco import rollout, sysid
from numpy import ndarray
from torch import Tensor

from onlinebayes.identification import Windows
from onlinebayes.simulators.mujoco.model import quiet
from recipes.studies.versus_sysid.sysid_parameters import Freed, every_parameter, prepared
from recipes.studies.versus_sysid.task import Fitted, Task

SD = 3.0
ITERATIONS = 60
HALF = 1.96  # sd in half of the 95 % interval
FAR = 1e6  # what a simulation that diverged counts as, in noise


@final
@dataclass(frozen=True)
class Problem:
    """A least-squares problem as ``mujoco.sysid`` takes it.

    Args:
        task: the case.
        freed: its parameters.
        spec: the model with a bias actuator a joint.
    """

    task: Task
    freed: tuple[Freed, ...]
    spec: mujoco.MjSpec

    @classmethod
    def of(cls, task: Task, freed: Sequence[Freed]) -> Problem:
        """The fit windows of a task."""
        return cls(task, tuple(freed), prepared(task))

    @property
    def parameters(self) -> sysid.ParameterDict:
        """At their starts."""
        found = sysid.ParameterDict()
        for freed in self.freed:
            found.add(sysid.Parameter(freed.name, freed.nominal, freed.low, freed.high, modifier=_modifier(freed)))
            found[freed.name].value[:] = freed.start
        return found

    def residual(self, x: ndarray, params: sysid.ParameterDict) -> tuple[list[ndarray], list[Any], list[Any]]:
        """Weighed residuals, a column for each column of x."""
        windows = self.task.fit_windows
        columns = [self.weighed(values, windows, params) for values in x.reshape(len(self.freed), -1).T]
        return [np.stack(columns, 1) if x.ndim > 1 else columns[0]], [], []

    def weighed(self, x: ndarray, windows: Windows, params: sysid.ParameterDict) -> Float[ndarray, " n"]:
        """simulated - measured at x over windows, at what was measured [noise]."""
        wrong = (self.simulated(x, windows, params) - windows.value.numpy()) / self.task.noise.numpy()
        return np.nan_to_num(wrong[windows.measured.numpy()], nan=FAR, posinf=FAR, neginf=-FAR)

    def simulated(self, x: ndarray, windows: Windows, params: sysid.ParameterDict) -> Float[ndarray, "W K S"]:
        """Signals at x over windows."""
        params.update_from_vector(x)
        model = sysid.apply_param_modifiers(params, self.spec)
        late = float(params["late"].value[0]) if "late" in params else 0.0
        return _simulated(model, windows, late)


def fit(task: Task) -> Fitted:
    """Free everything, optimise, and name what left its nominal value."""
    problem = Problem.of(task, every_parameter(task))
    x, jacobian = optimised(problem, ITERATIONS)
    residual, _, _ = problem.residual(x, problem.parameters)
    with np.errstate(all="ignore"):  # what the data leave open has an infinite interval
        _, half = sysid.calculate_intervals(residual, jacobian)
    away = np.abs(x - np.array([freed.nominal for freed in problem.freed])) * HALF
    found = [freed.claim for freed, sure in zip(problem.freed, away > SD * half, strict=True) if sure and freed.claim]

    def predict(windows: Windows) -> Tensor:
        return torch.from_numpy(problem.simulated(x, windows, problem.parameters))

    return Fitted(tuple(dict.fromkeys(found)), predict)


def optimised(problem: Problem, iterations: int) -> tuple[Float[ndarray, " P"], Float[ndarray, "n P"]]:
    """sysid's optimum and the Jacobian there."""
    _, result = sysid.optimize(
        problem.parameters,
        problem.residual,
        optimizer="mujoco",
        max_iters=iterations,
        x_scale="jac",
        output=io.StringIO(),
    )
    return np.asarray(result.x).ravel(), np.asarray(result.jac)


def _modifier(freed: Freed) -> Any:
    write = freed.write
    return None if write is None else (lambda spec, parameter: write(spec, float(parameter.value[0])))


def _simulated(model: mujoco.MjModel, windows: Windows, late: float) -> Float[ndarray, "W K S"]:
    """Signals of one model, all windows in one rollout, read ``late`` seconds late."""
    step, J = float(model.opt.timestep), windows.start.shape[1] // 2
    fine = round(windows.step / step)
    start, command = windows.start.numpy(), np.repeat(windows.command.numpy(), fine, axis=1)
    idle = np.zeros((*command.shape[:2], model.nu - command.shape[2]))  # the bias actuators take no command
    states = np.stack([sysid.create_initial_state(model, row[:J], row[J:]) for row in start])
    with quiet():
        moved, _ = rollout.rollout(model, mujoco.MjData(model), states, np.concatenate([command, idle], 2))
    path = np.concatenate([states[:, None], moved], 1)[..., 1 : 1 + 2 * J]
    return _read(path, np.arange(1, windows.rows + 1) * fine - late / step, step)[..., list(windows.columns)]


def _read(path: Float[ndarray, "W T J2"], at: Float[ndarray, " K"], step: float) -> Float[ndarray, "W K J2"]:
    """(q, v) at fractional steps; before its start a window is taken to have moved on as it begins."""
    low = np.floor(at).astype(int).clip(0, path.shape[1] - 2)
    part = (np.maximum(at, 0.0) - low)[:, None]
    read = (1 - part) * path[:, low] + part * path[:, low + 1]
    q, v = np.split(path[:, :1], 2, axis=2)
    return read + np.concatenate([v * np.minimum(at, 0.0)[:, None] * step, np.zeros((len(q), len(at), q.shape[2]))], 2)
