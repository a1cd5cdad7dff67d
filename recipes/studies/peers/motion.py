"""How the fit runs moved, smoothed, and the force that the engineer's model does not account for.

    q, v, a   local polynomials of degree 3 over 2 m + 1 rows (Savitzky and Golay 1964),  a = k * q'' = k * acceleration
    F         = M(q) (a - k * a_base(q, v, u; theta))                                             [N, N m]
    F_p       = M(q) (k * d a_base / d theta_p):       what a change of parameter p would explain

Smoothing dampens the measured acceleration, so that the model's goes through the same kernel k before the two are
compared; without it every fast force looked too small. The model's own acceleration stands in F_p, for the measured
one's noise would bias the regression towards light masses. Where velocities were measured, a is their derivative.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import mujoco
import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.signal import convolve, savgol_coeffs, savgol_filter

from onlinebayes.identification import RunGrid, Windows, joint_names, run_grids, seen_by
from onlinebayes.simulators.mujoco import MujocoSimulator
from recipes.studies.peers.task import Task

DEGREE = 3
DIFFERENCE = 1e-4  # of a parameter's bounds


@final
@dataclass(frozen=True)
class Motion:
    """The smoothed fit windows, W of K rows, and the n rows of them that a regression uses.

    Args:
        q, v, a: smoothed [SI].
        kernel: k.
        kept: flat numbers of the n rows: those that smoothing saw from both sides, evenly thinned.
    """

    q: Float[ndarray, "W K J"]
    v: Float[ndarray, "W K J"]
    a: Float[ndarray, "W K J"]
    kernel: Float[ndarray, " L"]
    kept: Int[ndarray, " n"]

    @property
    def window(self) -> Int[ndarray, " n"]:
        """The window of each kept row."""
        return self.kept // self.q.shape[1]

    def smoothed(self, rows: Float[ndarray, "W K *rest"]) -> Float[ndarray, n * rest]:
        """k * rows at the kept rows."""
        shape = (1, len(self.kernel), *[1] * (rows.ndim - 2))
        found = convolve(rows, self.kernel.reshape(shape), mode="same", method="direct")
        return self.at(found)

    def at(self, rows: Float[ndarray, "W K *rest"]) -> Float[ndarray, n * rest]:
        """The kept rows."""
        return rows.reshape(-1, *rows.shape[2:])[self.kept]


def motion(task: Task, seconds: float, most: int) -> Motion:
    """The motion in the fit windows.

    Args:
        task: gives runs and windows.
        seconds: length of the polynomials [s]; at least 5 rows.
        most: about how many rows to keep.
    """
    windows = task.fit_windows
    grids = run_grids(task.fit_runs, windows.step)
    shortest = min(windows.rows, *(grid.rows for grid in grids))
    half = max(2, min(round(0.5 * seconds / windows.step), (shortest - 1) // 4))
    runs = [_run(task, grid, 2 * half + 1) for grid in grids]
    k = np.arange(windows.rows)
    columns: list[tuple[ndarray, ...]] = []
    good: list[Bool[ndarray, " K"]] = []
    for w in range(windows.count):
        run, rows = runs[int(windows.run[w])], int(windows.first[w]) + k
        last = len(run[0]) - 1
        columns.append(tuple(column[rows.clip(0, last)] for column in run))
        # k reaches half rows to both sides inside the window, the polynomials as far inside the run.
        good.append((k >= half) & (k < windows.rows - half) & (rows >= 2 * half) & (rows <= last - 2 * half))
    kept = np.flatnonzero(np.concatenate(good))
    kept = kept[:: max(1, len(kept) // most)]
    q, v, a = (np.stack(part) for part in zip(*columns, strict=True))
    return Motion(q, v, a, _kernel(2 * half + 1, 1 if _by_speed(task) else 2), kept)


def _by_speed(task: Task) -> bool:
    """Whether every joint's velocity was measured."""
    return all(f"qvel.{joint}" in task.signals for joint in joint_names(task.simulator))


def _kernel(length: int, order: int) -> Float[ndarray, " L"]:
    """k: its derivative of that order is the polynomials' own kernel; its sum is 1."""
    c = savgol_coeffs(length, DEGREE, deriv=order, use="dot")
    if order == 2:
        return np.cumsum(np.cumsum(c))[:-2] if length > 2 else np.ones(1)
    between = -np.cumsum(c)[:-1]  # of the intervals between rows, half to the row on either side
    return 0.5 * (np.append(between, 0.0) + np.insert(between, 0, 0.0))


def _run(task: Task, grid: RunGrid, length: int) -> tuple[ndarray, ndarray, ndarray]:
    """q, v, a of one run at all rows (G1, J)."""
    columns = []
    for joint in joint_names(task.simulator):
        value = _filled(grid, seen_by(joint, task.signals).column)
        if _by_speed(task):
            speed = _filled(grid, task.signals.index(f"qvel.{joint}"))
            derived = [savgol_filter(speed, length, DEGREE, deriv=d, delta=grid.step) for d in (0, 1)]
        else:
            derived = [savgol_filter(value, length, DEGREE, deriv=d, delta=grid.step) for d in (1, 2)]
        columns.append((savgol_filter(value, length, DEGREE), *derived))
    q, v, a = (np.stack(part, -1) for part in zip(*columns, strict=True))
    return q, v, a


def _filled(grid: RunGrid, column: int) -> Float[ndarray, " G1"]:
    """One signal, straight lines over rows that were not observed."""
    rows, seen = np.arange(grid.rows + 1), grid.observed[:, column].numpy()
    return np.interp(rows, rows[seen], grid.value[:, column].numpy()[seen])


@final
@dataclass(frozen=True)
class Forces:
    """What the base model leaves unexplained at the kept rows.

    Args:
        residual: F.
        sensitivity: F_p of each parameter.
    """

    residual: Float[ndarray, "n J"]
    sensitivity: Float[ndarray, "n P J"]


def forces(
    simulator: MujocoSimulator, theta: Float[ndarray, " P"], moved: Motion, command: Float[ndarray, "W K U"]
) -> Forces:
    """F and F_p at theta, under commands centred on the rows."""
    model = simulator.export(torch.from_numpy(theta)).compile()
    expected = _acceleration(model, moved, command)
    residual = moved.at(moved.a) - moved.smoothed(expected)
    space, columns = simulator.parameters, []
    width = (space.high - space.low).numpy()
    for p in range(len(theta)):
        away = theta.copy()
        away[p] += DIFFERENCE * width[p] * (1 if theta[p] + DIFFERENCE * width[p] <= float(space.high[p]) else -1)
        other = _acceleration(simulator.export(torch.from_numpy(away)).compile(), moved, command)
        columns.append(moved.smoothed(other - expected) / (away[p] - theta[p]))
    together = np.stack([residual, *columns], 1)
    return Forces(*(part for part in _split(_weighed(model, moved.at(moved.q), together))))


def _split(together: Float[ndarray, "n P1 J"]) -> tuple[ndarray, ndarray]:
    return together[:, 0], together[:, 1:]


def _acceleration(model: mujoco.MjModel, moved: Motion, command: ndarray) -> Float[ndarray, "W K J"]:
    """What the base model does at each row."""
    q, v, u = (part.reshape(-1, part.shape[2]) for part in (moved.q, moved.v, command))
    data, found = mujoco.MjData(model), np.empty_like(q)
    for i in range(len(found)):
        data.qpos[:], data.qvel[:], data.ctrl[:] = q[i], v[i], u[i]
        mujoco.mj_forward(model, data)
        found[i] = data.qacc
    return found.reshape(moved.q.shape)


def _weighed(model: mujoco.MjModel, q: Float[ndarray, "n J"], a: Float[ndarray, "n C J"]) -> Float[ndarray, "n C J"]:
    """M(q) a."""
    data, found = mujoco.MjData(model), np.empty_like(a)
    full = np.zeros((model.nv, model.nv))
    for i in range(len(q)):
        data.qpos[:] = q[i]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fullM(model, data, full)
        found[i] = a[i] @ full
    return found


def folds(windows: Windows, count: int = 4) -> Int[ndarray, " W"]:
    """Fold of each window: whole runs where there are enough, else stretches of time."""
    runs = len(windows.runs)
    if runs >= count:
        return windows.run.numpy() * count // runs
    return np.arange(windows.count) * count // windows.count


def cross_validated(windows: Windows, squares: Float[ndarray, "C W S"], noise: Float[ndarray, " S"]) -> ndarray:
    """Error of C models over all fit windows, RMS over signals and rows, in units of noise (C,)."""
    rows: Bool[ndarray, "W S"] = windows.measured.sum(1).numpy()
    return np.sqrt((squares.sum(1) / rows.sum(0).clip(1) / noise**2).mean(-1))
