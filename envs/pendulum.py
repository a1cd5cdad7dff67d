r"""Pendulum: a rod swung up by a torque too weak to lift it at once.

    d w/dt = 3 g / (2 l) sin(phi) + 3 / (m l^2) (u + tau)

phi angle from upright [rad], w its rate, cut off at 8 rad/s; u torque, cut off at 2 N m. The same system, step and
reward as Gymnasium's ``Pendulum-v1``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Bounded

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators import Actuator, Joint, Task, TorchSimulator
from onlinebayes.simulators.drawing import BLUE, DARK, Shape, planar

MAX_TORQUE = 2.0  # [N m]
MAX_SPEED = 8.0  # [rad/s]


class Pendulum(TorchSimulator):
    """Batched pendulum with Gymnasium's parameters; the command is the torque [N m]."""

    physical = ParameterSpace(
        {
            "length": Parameter(0.01, 10.0, "m", "log"),
            "mass": Parameter(0.001, 100.0, "kg", "log"),
            "gravity": Parameter(0.0, 30.0, "m/s2"),
        }
    )
    defaults = {"length": 1.0, "mass": 1.0, "gravity": 10.0}  # noqa: RUF012
    joints = (Joint("hinge", "hinge", max_speed=MAX_SPEED),)
    actuators = (Actuator("motor", "hinge", limit=MAX_TORQUE),)
    timestep = 0.05

    def acceleration(
        self,
        parameters: Mapping[str, Float[Tensor, " N"]],
        q: Float[Tensor, "J N"],
        v: Float[Tensor, "J N"],
        tau: Float[Tensor, "J N"],
    ) -> Float[Tensor, "J N"]:
        """Angular acceleration [rad/s^2]; see the module."""
        length = parameters["length"]
        return 1.5 * parameters["gravity"] / length * torch.sin(q) + 3.0 / (parameters["mass"] * length**2) * tau

    def shapes(self, theta: Float[Tensor, " P"]) -> tuple[Shape, ...]:
        """Axle and a rod of its true length, thicker the heavier it is."""
        values = self._named(theta)
        length, mass = float(values["length"]), float(values["mass"])
        radius = 0.06 * length * min(max(mass / length, 0.1), 4.0) ** 0.5
        return (
            Shape("rod", "capsule", (radius, length / 2), BLUE),
            Shape("axle", "sphere", (0.6 * radius,), DARK, moving=False),
        )

    def poses(self, theta: Float[Tensor, " P"], states: TensorDictBase) -> Float[Tensor, "T 2 7"]:
        """See :class:`~onlinebayes.simulators.Drawable`."""
        half, angle = float(self._named(theta)["length"]) / 2, states.get("qpos")[..., 0]
        zero = torch.zeros_like(angle)
        rod = planar(half * torch.sin(angle), half * torch.cos(angle), angle)
        return torch.stack((rod, planar(zero, zero, zero, -0.06 * 2 * half)), dim=1)


class PendulumTask(Task):
    """Swing up and hold: reward -(phi^2 + 0.1 w^2 + 0.001 u^2) with phi in [-pi, pi]; 200 steps.

    Observation (cos phi, sin phi, w); action the torque in [-2, 2] N m.

    Args:
        horizon: steps of an episode.
    """

    observation_size = 3
    channels: Mapping[str, Mapping[str, str]] = {
        "observation": {"cos angle": "", "sin angle": "", "rate": "rad/s"},
        "action": {"torque": "N m"},
    }

    def __init__(self, horizon: int = 200) -> None:
        self.horizon = horizon
        self.action_spec = Bounded(-MAX_TORQUE, MAX_TORQUE, shape=(1,), dtype=torch.float32)

    def start(self, theta: Float[Tensor, "n P"], generator: torch.Generator) -> TensorDict:
        """Angle uniform in [-pi, pi], rate uniform in [-1, 1] rad/s."""
        draws = 2 * torch.rand(len(theta), 2, dtype=theta.dtype, device=theta.device, generator=generator) - 1
        angle, rate = draws.split(1, dim=-1)
        return TensorDict({"qpos": math.pi * angle, "qvel": rate}, batch_size=(len(theta),), device=theta.device)

    def observe(self, state: TensorDictBase) -> Float[Tensor, "N 3"]:
        """(cos phi, sin phi, w) [1, 1, rad/s]."""
        angle = state.get("qpos")
        return torch.cat((angle.cos(), angle.sin(), state.get("qvel")), dim=-1).to(torch.float32)

    def command(self, action: Tensor) -> Float[Tensor, "N 1"]:
        """The torque [N m]; the simulator cuts it off."""
        return action

    def reward(self, state: TensorDictBase, action: Tensor, after: TensorDictBase) -> Float[Tensor, " N"]:
        """-(phi^2 + 0.1 w^2 + 0.001 u^2) of the state before the step and the torque that acted."""
        angle, rate = state.get("qpos")[..., 0], state.get("qvel")[..., 0]
        torque = action[..., 0].to(angle.dtype).clamp(-MAX_TORQUE, MAX_TORQUE)
        wrapped = torch.remainder(angle + math.pi, 2 * math.pi) - math.pi
        return -(wrapped.square() + 0.1 * rate.square() + 0.001 * torque.square())

    def terminated(self, state: TensorDictBase) -> Bool[Tensor, " N"]:
        """Never."""
        return torch.zeros(state.batch_size, dtype=torch.bool, device=state.device)
