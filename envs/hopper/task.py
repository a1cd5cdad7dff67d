"""Hop forward without falling.

r = v_x + 1 - 0.001 sum(u^2),     v_x the torso's mean velocity over the step [m/s]
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Bounded

from envs.hopper.physics import DT
from onlinebayes.simulators import Task

FALLEN = -0.45
"""Height of the torso over where it stands upright, below which the hopper has fallen [m]."""

TILTED = 0.6
"""Pitch of the torso at which it has fallen [rad]."""


class HopperTask(Task):
    """Observation (11,): all of qpos but x, then qvel cut off at 10; action: three motors in [-1, 1].

    Args:
        horizon: steps of an episode, 8 ms each.
        upright: the torso's coordinate z where it stands upright [m].
        fallen: height of the torso over that, below which it has fallen [m].
        tilted: pitch of the torso at which it has fallen [rad].
    """

    observation_size = 11
    channels: Mapping[str, Mapping[str, str]] = {
        "observation": {
            "z": "m",
            **{f"{joint} angle": "rad" for joint in ("pitch", "hip", "knee", "ankle")},
            "x velocity": "m/s",
            "z velocity": "m/s",
            **{f"{joint} rate": "rad/s" for joint in ("pitch", "hip", "knee", "ankle")},
        },
        "action": {f"{joint} motor": "of its limit" for joint in ("hip", "knee", "ankle")},
    }

    def __init__(
        self, horizon: int = 1000, upright: float = 0.0, fallen: float = FALLEN, tilted: float = TILTED
    ) -> None:
        self.horizon, self.upright, self.fallen, self.tilted = horizon, upright, fallen, tilted
        self.action_spec = Bounded(-1.0, 1.0, shape=(3,), dtype=torch.float32)

    def start(self, theta: Float[Tensor, "n P"], generator: torch.Generator) -> TensorDict:
        """Upright and at rest, each coordinate and velocity off by up to 5e-3 [m, rad, m/s, rad/s]."""
        noise = 0.01 * torch.rand(len(theta), 12, dtype=theta.dtype, device=theta.device, generator=generator) - 0.005
        noise[:, 1] += self.upright
        return TensorDict({"qpos": noise[:, :6], "qvel": noise[:, 6:]}, batch_size=(len(theta),), device=theta.device)

    def observe(self, state: TensorDictBase) -> Float[Tensor, "N 11"]:
        """(z, pitch, hip, knee, ankle) and all velocities."""
        return torch.cat((state.get("qpos")[..., 1:], state.get("qvel").clamp(-10, 10)), dim=-1).to(torch.float32)

    def command(self, action: Tensor) -> Float[Tensor, "N 3"]:
        """The motors' commands, shares of their gears."""
        return action

    def reward(self, state: TensorDictBase, action: Tensor, after: TensorDictBase) -> Float[Tensor, " N"]:
        """Forward velocity, one where it has not fallen, less the effort."""
        speed = (after.get("qpos")[..., 0] - state.get("qpos")[..., 0]) / DT
        return speed + (~self.terminated(after)).to(speed) - 1e-3 * action.to(speed).square().sum(-1)

    def terminated(self, state: TensorDictBase) -> Bool[Tensor, " N"]:
        """Check whether it has fallen: too low, or tilted too far."""
        qpos = state.get("qpos")
        return (qpos[..., 1] < self.upright + self.fallen) | (qpos[..., 2].abs() > self.tilted)
