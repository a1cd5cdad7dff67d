"""The engineer's model driven by one more force: base + residual, for methods that learn what the model lacks.

    M(q; theta) v' + c(q, v; theta) = actuators(q, v, u; theta) + f(q, v, drives),     f held over at most 1 ms

MuJoCo integrates the base by its own integrator; f is given by the method, for all worlds at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import final

import mujoco
import mujoco.batch
import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from onlinebayes.identification import Windows
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco.model import batch_model, quiet

LONGEST_STEP = 1e-3
"""Over which f is held [s]."""


@final
@dataclass(frozen=True)
class Course:
    """How N things were driven over K rows: what follows from the commands alone.

    Args:
        time: since the run began [s].
        command: u.
        late: u of some dead time ago.
        lagged: u through a first-order lag.
        heat: h of T dh/dt = (u / u_ref)^2 - h, in units of the largest command.
    """

    time: Float[ndarray, "N K"]
    command: Float[ndarray, "N K U"]
    late: Float[ndarray, "N K U"]
    lagged: Float[ndarray, "N K U"]
    heat: Float[ndarray, "N K U"]

    def row(self, k: int) -> Course:
        """Row k alone, the axis K gone."""
        return Course(*(part[:, k] for part in self._parts()))

    def flat(self) -> Course:
        """N K rows, one axis for both."""
        return Course(*(part.reshape(-1, *part.shape[2:]) for part in self._parts()))

    def centred(self) -> Course:
        """Averages over the intervals before and after each row: what a central difference about it sees."""
        return Course(*(np.concatenate([part[:, :1], 0.5 * (part[:, 1:] + part[:, :-1])], 1) for part in self._parts()))

    def tiled(self, copies: int) -> Course:
        """The same N, ``copies`` times over."""
        return Course(*(np.tile(part, (copies, *[1] * (part.ndim - 1))) for part in self._parts()))

    def picked(self, rows: Int[ndarray, " n"]) -> Course:
        """Some of the N."""
        return Course(*(part[rows] for part in self._parts()))

    def _parts(self) -> tuple[ndarray, ...]:
        return tuple(getattr(self, field.name) for field in fields(self))


def course(windows: Windows, dead_time: ndarray, lag: ndarray, warming: ndarray, reference: ndarray) -> Course:
    """The course of every window, its history before it included.

    Args:
        windows: W of K rows, with their history.
        dead_time, lag, warming: one for each of the U actuators [s].
        reference: largest command of each.
    """
    h, rows = windows.step, windows.rows
    u = torch.cat([windows.history, windows.command], 1).numpy()
    # Actuators are off before a run begins: nothing has warmed up then.
    on = torch.cat([windows.history_enable, windows.enable], 1).numpy() > 0
    late, lagged, heat = u.copy(), u.copy(), np.zeros_like(u)
    for a in range(u.shape[2]):
        late[..., a] = _delayed(u[..., a], dead_time[a] / h)
        keep = math.exp(-h / max(lag[a], 1e-9))
        warm = math.exp(-h / max(warming[a], 1e-9))
        load = (u[..., a] / reference[a]) ** 2
        for k in range(1, u.shape[1]):
            lagged[:, k, a] = u[:, k, a] + keep * (lagged[:, k - 1, a] - u[:, k, a])
            heat[:, k, a] = np.where(on[:, k, a], load[:, k] + warm * (heat[:, k - 1, a] - load[:, k]), 0.0)
    begin = windows.first.numpy()[:, None] * h
    time = begin + np.arange(rows) * h
    return Course(time, windows.command.numpy(), *(part[:, -rows:] for part in (late, lagged, heat)))


def _delayed(u: Float[ndarray, "N T"], rows: float) -> Float[ndarray, "N T"]:
    """u of ``rows`` rows ago; the first one holds before the table."""
    whole, part = math.floor(rows), rows - math.floor(rows)
    index = np.arange(u.shape[1])
    near, far = u[:, np.maximum(index - whole, 0)], u[:, np.maximum(index - whole - 1, 0)]
    return (1 - part) * near + part * far


Force = Callable[[Float[ndarray, "N J"], Float[ndarray, "N J"], Course], Float[ndarray, "N J"]]
"""(q, v, the course at this row) -> generalised forces [N, N m]."""


def simulate(
    simulator: MujocoSimulator,
    theta: Float[ndarray, "N P"],
    windows: Windows,
    force: Force,
    driven: Course,
) -> Float[Tensor, "N K S"]:
    """Signals at the rows of N worlds, world n in window n modulo W; nan from where one diverges.

    Args:
        simulator: the base model; its signals are its joints' positions and velocities.
        theta: parameters of each world.
        windows: W of K rows.
        force: f.
        driven: the course of the N worlds.
    """
    copies, steps = len(theta) // windows.count, math.ceil(windows.step / LONGEST_STEP - 1e-9)
    simulator = simulator.with_timestep(windows.step / steps)
    batch = mujoco.batch.Batch(batch_model(simulator.model), len(theta), 1)
    for name, values in simulator.fields(theta).items():
        live = batch.expand(name)
        live[...] = values.reshape(live.shape)
    batch.set_const()
    qpos, qvel = batch.bind("qpos"), batch.bind("qvel")
    ctrl, applied = batch.bind("ctrl"), batch.bind("qfrc_applied")
    start = np.tile(windows.start.numpy(), (copies, 1))
    qpos[...], qvel[...] = np.split(start, 2, axis=1)
    signals = np.full((len(theta), windows.rows, len(simulator.signals)), np.nan)
    alive = np.ones(len(theta), dtype=bool)
    before, h = np.array(qvel), simulator.timestep
    for k in range(windows.rows):
        now = driven.row(k)
        ctrl[...] = now.command
        for _ in range(steps):
            # In the middle of the step, extrapolated: at its beginning f would come half a step late.
            v = np.array(qvel)
            pushed = force(qpos + 0.5 * h * v, 1.5 * v - 0.5 * before, now)
            before = v
            applied[...] = np.where(alive[:, None], np.nan_to_num(pushed), 0.0)
            _step(batch, alive)
        signals[alive, k] = np.concatenate([qpos, qvel], 1)[alive]
    return torch.from_numpy(signals[..., list(windows.columns)])


def _step(batch: mujoco.batch.Batch, alive: ndarray) -> None:
    """One timestep of the worlds that are alive; those that diverge in it are so no more."""
    if not alive.any():
        return
    try:
        with quiet():
            batch.step(ids=np.flatnonzero(alive).astype(np.int32))
    except mujoco.batch.SimulationError as error:
        alive[error.ids] = False
    alive &= ~batch.warning[:, :, 1].any(1)
