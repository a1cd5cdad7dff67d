"""Flights of a hopper that jumps off the floor in Drake: what is measured between two contacts, a run each.

    push-off: three torques of some 150 N m for .2 s from a crouch;      in the air: the tones of :mod:`.engines_data`

Contacts differ between the engines, so that a model is not held against them: rows in which something touches, and the
two beside them, are left out, and each flight that is left is a run of its own.
"""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np
import torch
from jaxtyping import Bool, Float
from numpy import ndarray
from tensordict import TensorDict
from torch import Tensor

from envs.hopper import DT, DrakeHopper

CROUCH = (0.0, 1.08, -0.53, -0.75, -0.4, 0.62)
"""From which it jumps [m, rad]; found by trying 400 of them with the push below."""

PUSH, BEGIN, END = (152.0, 73.0, -177.0), 0.05, 0.24
"""At thigh, leg and foot [N m], from when to when [s]."""

ROWS, BESIDE, SHORTEST = 100, 2, 25
"""Of a jump; left out beside a contact; of a flight that is kept."""


def jumps(
    machine: DrakeHopper, theta: Float[Tensor, "R P"], tones: Float[Tensor, "R T 3"], gear: float, draw: torch.Generator
) -> tuple[Float[Tensor, "R T 3"], Float[Tensor, "R T 6"]]:
    """Commands and positions of jumps, no two alike.

    Args:
        machine: worlds.
        theta: their parameters.
        tones: commands in the air.
        gear: of the motors [N m].
        draw: random numbers.
    """
    runs = len(theta)
    times = DT * torch.arange(ROWS, dtype=torch.float64)
    strength = 1 + 0.1 * torch.randn(runs, 1, 3, generator=draw, dtype=torch.float64)
    push = strength * torch.tensor(PUSH, dtype=torch.float64) / gear
    command = torch.where((times < END)[:, None], push * (times >= BEGIN)[:, None], tones[:, :ROWS])
    qpos = torch.tensor(CROUCH, dtype=torch.float64).repeat(runs, 1)
    qpos[:, 3:] += 0.03 * torch.randn(runs, 3, generator=draw, dtype=torch.float64)
    start = TensorDict({"qpos": qpos, "qvel": torch.zeros_like(qpos)}, batch_size=[runs])
    held = TensorDict({"command": command[:, :-1]}, batch_size=[runs, ROWS - 1])
    path = machine.rollout(theta, start, held, times[1:])["qpos"]
    return command, torch.cat([qpos[:, None], path], dim=1)


def flights(free: Bool[ndarray, " T"]) -> Iterator[slice]:
    """Stretches of rows in which nothing touches anything.

    Args:
        free: whether nothing does, row by row.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(int)))
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if end - begin - 2 * BESIDE >= SHORTEST:
            yield slice(begin + BESIDE, end - BESIDE)


def touching_nothing(model: mujoco.MjModel, path: Float[ndarray, "T 6"], room: float) -> Bool[ndarray, " T"]:
    """Row by row whether nothing touches anything, and no joint is within ``room`` [rad] of an end."""
    low, high = model.jnt_range[3:].T
    free = ((path[:, 3:] > low + room) & (path[:, 3:] < high - room)).all(1)
    data = mujoco.MjData(model)
    for k in np.flatnonzero(free):
        data.qpos[:] = path[k]
        mujoco.mj_fwdPosition(model, data)
        free[k] = data.ncon == 0
    return np.asarray(free)
