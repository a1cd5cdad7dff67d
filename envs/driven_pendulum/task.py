"""Holding the driven pendulum upright: a task in which the physics of the actuator matters.

    r = max(0, 1 - |x| - 0.005 x'^2),     x = q - pi wrapped to [-pi, pi],     over when |x| > 1

A step at rest upright is worth 1, so a return counts the steps held. The motor is stronger than gravity: a policy that
knows only a prompt motor learns to react hard, and a delay of a few control periods then shakes the bob off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Bounded, TensorSpec

from onlinebayes.simulators import Task


class BalanceTask(Task):
    """Catch the pendulum near its upright position and hold it there.

    The observation (3,) is cos x, sin x and the speed in tens of rad/s; the action (1,) in [-1, 1] is the motor torque
    in units of ``torque``.

    Args:
        torque: the motor's limit [N m].
        period: of the control loop [s].
        seconds: length of an episode [s].
        angle: farthest start from upright [rad].
        speed: greatest speed at the start [rad/s].
    """

    channels: Mapping[str, Mapping[str, str]] = {
        "observation": {"cos angle": "", "sin angle": "", "rate": "10 rad/s"},
        "action": {"torque": "of the motor's limit"},
    }

    def __init__(
        self,
        torque: float = 2.0,
        period: float = 0.02,
        seconds: float = 2.0,
        angle: float = 0.4,
        speed: float = 1.0,
    ) -> None:
        self.torque, self.period, self.angle, self.speed = torque, period, angle, speed
        self.observation_size = 3
        self.action_spec: TensorSpec = Bounded(-1.0, 1.0, (1,), dtype=torch.float32)
        self.horizon = round(seconds / period)

    def start(self, theta: Float[Tensor, "n P"], generator: torch.Generator) -> TensorDict:
        """Uniformly within ``angle`` of upright and within ``speed``."""
        draw = 2 * torch.rand(len(theta), 2, generator=generator, dtype=theta.dtype, device=theta.device) - 1
        qpos, qvel = math.pi + self.angle * draw[:, :1], self.speed * draw[:, 1:]
        return TensorDict({"qpos": qpos, "qvel": qvel}, batch_size=(len(theta),))

    def observe(self, state: TensorDictBase) -> Float[Tensor, "N O"]:
        """cos x, sin x and x' / 10."""
        x = state["qpos"] - math.pi
        return torch.cat([torch.cos(x), torch.sin(x), state["qvel"] / 10], dim=-1).to(torch.float32)

    def command(self, action: Tensor) -> Float[Tensor, "N U"]:
        """Motor torque [N m]."""
        return self.torque * action

    def reward(self, state: TensorDictBase, action: Tensor, after: TensorDictBase) -> Float[Tensor, " N"]:
        """1 at rest upright, less with the angle and the speed."""
        return (1 - _off_upright(after).abs() - 0.005 * after["qvel"][:, 0].square()).clamp(min=0)

    def terminated(self, state: TensorDictBase) -> Bool[Tensor, " N"]:
        """Farther than 1 rad from upright."""
        return _off_upright(state).abs() > 1


def _off_upright(state: TensorDictBase) -> Tensor:
    return torch.remainder(state["qpos"][:, 0], 2 * math.pi) - math.pi
