"""A pendulum whose commands, sensor or clock are late by a known amount."""

from __future__ import annotations

import numpy as np
import torch
from tensordict import TensorDict

from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import ActuatorDelay
from tests.criticism.wired import NOISE, PENDULUM, STEP

SIGNAL = "qpos.hinge"
CYCLE, DRIVEN = 2.0, 1.2  # [s]


def measure(
    *, runs: int, seconds: float, transport: float = 0.0, sensor: float = 0.0, drift: float = 0.0, coasts: bool = False
) -> Measurement:
    """Runs from rest under three tones each.

    Args:
        runs, seconds: how many, and how long [s].
        transport: by which commands are late [s].
        sensor: by which the sensor is [s].
        drift: by which its lag grows [s/s].
        coasts: whether the motor is off for two fifths of every two seconds, as the log says.
    """
    truth, rows = PENDULUM.model().with_timestep(STEP / 8), round(seconds / STEP) + 1
    truth = truth.with_effect(ActuatorDelay("motor", Parameter(0.0, 0.2, "s")))
    draw, t = torch.Generator().manual_seed(1), torch.arange(rows, dtype=torch.float64) * STEP
    frequency = 0.3 + 1.2 * torch.rand(runs, 3, 1, generator=draw, dtype=torch.float64)
    phase = 6.3 * torch.rand(runs, 3, 1, generator=draw, dtype=torch.float64)
    command = PENDULUM.drive[0] * torch.sin(6.2832 * frequency * t + phase).sum(1)[..., None]
    enable = torch.ones_like(command)
    enable[:, (t % CYCLE) > DRIVEN] = 0.0 if coasts else 1.0
    zero = torch.zeros(runs, 1, dtype=torch.float64)
    path = truth.rollout(
        torch.tensor([*PENDULUM.truth, transport], dtype=torch.float64).expand(runs, -1),
        TensorDict({"qpos": zero, "qvel": zero}, batch_size=(runs,)),
        TensorDict({"command": command[:, :-1], "enable": enable[:, :-1]}, batch_size=(runs, rows - 1)),
        t[1:],
    )
    q, v = (torch.cat([zero, path[name][..., 0]], 1) for name in ("qpos", "qvel"))
    noise = NOISE * torch.randn(q.shape, generator=draw, dtype=q.dtype)
    shown = _between(q, v, (t - sensor - drift * t).clamp_min(0.0)) + noise
    table = {
        f"run{r}": {"time": t.numpy(), "ctrl.motor": command[r, :, 0].numpy(), SIGNAL: shown[r].numpy()}
        | ({"enable.motor": enable[r, :, 0].numpy()} if coasts else {})
        for r in range(runs)
    }
    return Measurement.from_runs(table, signals=[Signal(SIGNAL, "rad", sd=NOISE)], commands=["motor"])


def _between(q: torch.Tensor, v: torch.Tensor, then: torch.Tensor) -> torch.Tensor:
    """The motion at other instants, by the cubic through positions and velocities of the rows around (Hermite)."""
    k = torch.from_numpy(np.floor(then.numpy() / STEP + 1e-9)).long().clamp(0, q.shape[1] - 2)
    s = then / STEP - k
    here, there = q[:, k], q[:, k + 1]
    rising = STEP * (s * (1 - s) ** 2 * v[:, k] - s**2 * (1 - s) * v[:, k + 1])
    return here * (1 + 2 * s) * (1 - s) ** 2 + there * s**2 * (3 - 2 * s) + rising
