r"""Acrobot: two links on a pivot, driven at the joint between them only, swung up until the tip is high above it.

    d1 = m1 lc1^2 + m2 (l1^2 + lc2^2 + 2 l1 lc2 cos q2) + 2 I,      d2 = m2 (lc2^2 + l1 lc2 cos q2) + I
    f2 = m2 lc2 g cos(q1 + q2 - pi/2)
    f1 = -m2 l1 lc2 w2^2 sin q2 - 2 m2 l1 lc2 w2 w1 sin q2 + (m1 lc1 + m2 l1) g cos(q1 - pi/2) + f2
    a2 = (t2 + d2/d1 (f1 - t1) - m2 l1 lc2 w1^2 sin q2 - f2) / (m2 lc2^2 + I - d2^2/d1)
    a1 = (t1 - d2 a2 - f1) / d1

q1 angle of the first link from hanging, q2 of the second from the first [rad], w1 and w2 their rates, cut off at 4 pi
and 9 pi rad/s; t torques, of which the motor gives t2; g = 9.8. The same system, step (one of Runge and Kutta's method,
0.2 s) and reward as Gymnasium's ``Acrobot-v1`` with the book's dynamics (Sutton 1996; Sutton and Barto). The length of
the second link is in none of the equations, and no data can say anything about it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import OneHot

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators import Actuator, Joint, Task, TorchSimulator
from onlinebayes.simulators.drawing import BLUE, DARK, GREY, RED, Shape, planar

GRAVITY = 9.8  # [m/s^2]
MAX_SPEEDS = (4 * math.pi, 9 * math.pi)  # [rad/s]


class Acrobot(TorchSimulator):
    """Batched acrobot with Gymnasium's parameters; the command is the torque at the elbow [N m].

    ``length1`` and ``length2`` are the links' lengths, ``com1`` and ``com2`` the distances of their centres of mass
    from their joints, ``moment`` each link's moment of inertia.
    """

    physical = ParameterSpace(
        {
            "length1": Parameter(0.05, 10.0, "m", "log"),
            "length2": Parameter(0.05, 10.0, "m", "log"),
            "mass1": Parameter(0.05, 10.0, "kg", "log"),
            "mass2": Parameter(0.05, 10.0, "kg", "log"),
            "com1": Parameter(0.01, 5.0, "m", "log"),
            "com2": Parameter(0.01, 5.0, "m", "log"),
            "moment": Parameter(0.01, 10.0, "kg m2", "log"),
        }
    )
    defaults = {  # noqa: RUF012
        "length1": 1.0,
        "length2": 1.0,
        "mass1": 1.0,
        "mass2": 1.0,
        "com1": 0.5,
        "com2": 0.5,
        "moment": 1.0,
    }
    joints = (Joint("shoulder", "hinge", max_speed=MAX_SPEEDS[0]), Joint("elbow", "hinge", max_speed=MAX_SPEEDS[1]))
    actuators = (Actuator("motor", "elbow", limit=1.0),)
    timestep = 0.2
    integrator = "rk4"

    def acceleration(
        self,
        parameters: Mapping[str, Float[Tensor, " N"]],
        q: Float[Tensor, "J N"],
        v: Float[Tensor, "J N"],
        tau: Float[Tensor, "J N"],
    ) -> Float[Tensor, "J N"]:
        """Angular accelerations of both links [rad/s^2]; see the module."""
        l1, m1, m2, lc1, lc2, moment = (
            parameters[name] for name in ("length1", "mass1", "mass2", "com1", "com2", "moment")
        )
        sin2, cos2 = torch.sin(q[1]), torch.cos(q[1])
        reach = m2 * l1 * lc2
        d1 = m1 * lc1**2 + m2 * (l1**2 + lc2**2) + 2 * reach * cos2 + 2 * moment
        d2 = m2 * lc2**2 + reach * cos2 + moment
        f2 = m2 * lc2 * GRAVITY * torch.cos(q[0] + q[1] - math.pi / 2)
        f1 = -reach * v[1] * (v[1] + 2 * v[0]) * sin2
        f1 = f1 + (m1 * lc1 + m2 * l1) * GRAVITY * torch.cos(q[0] - math.pi / 2) + f2
        a2 = tau[1] + d2 / d1 * (f1 - tau[0]) - reach * v[0].square() * sin2 - f2
        a2 = a2 / (m2 * lc2**2 + moment - d2.square() / d1)
        return torch.stack(((tau[0] - d2 * a2 - f1) / d1, a2))

    def shapes(self, theta: Float[Tensor, " P"]) -> tuple[Shape, ...]:
        """The two links, their joints, and the height that the tip has to reach."""
        values = self._named(theta)
        first, second = float(values["length1"]), float(values["length2"])
        return (
            Shape("goal", "box", (first + second, 0.02, 0.01), GREY, moving=False),
            Shape("link1", "capsule", (0.09, first / 2), BLUE),
            Shape("link2", "capsule", (0.075, second / 2), RED),
            Shape("shoulder", "sphere", (0.05,), DARK, moving=False),
            Shape("elbow", "sphere", (0.05,), DARK),
        )

    def poses(self, theta: Float[Tensor, " P"], states: TensorDictBase) -> Float[Tensor, "T 5 7"]:
        """See :class:`~onlinebayes.simulators.Drawable`; the goal is one of Gymnasium's links above."""
        values = self._named(theta)
        first, second = float(values["length1"]), float(values["length2"])
        a, b = states.get("qpos")[..., 0], states.get("qpos").sum(-1)
        zero = torch.zeros_like(a)
        x, z = first * torch.sin(a), -first * torch.cos(a)
        links = (
            planar(x / 2, z / 2, math.pi - a),
            planar(x + second / 2 * torch.sin(b), z - second / 2 * torch.cos(b), math.pi - b, -0.06),
        )
        joints = planar(zero, zero, zero, -0.12), planar(x, z, zero, -0.12)
        return torch.stack((planar(zero, zero + 1, zero), *links, *joints), dim=1)


class AcrobotTask(Task):
    """Swing the tip above the pivot by a link's length: reward -1 a step, 0 for the last; 500 steps at most.

    Observation (cos q1, sin q1, cos q2, sin q2, w1, w2); action one-hot of the torques (-1, 0, 1) N m.

    Args:
        horizon: steps of an episode.
    """

    observation_size = 6
    channels: Mapping[str, Mapping[str, str]] = {
        "observation": {
            "cos angle 1": "",
            "sin angle 1": "",
            "cos angle 2": "",
            "sin angle 2": "",
            "rate 1": "rad/s",
            "rate 2": "rad/s",
        },
        "action": {"torque -1 N m": "", "no torque": "", "torque 1 N m": ""},
    }

    def __init__(self, horizon: int = 500) -> None:
        self.horizon = horizon
        self.action_spec = OneHot(3, dtype=torch.int64)

    def start(self, theta: Float[Tensor, "n P"], generator: torch.Generator) -> TensorDict:
        """Angles and rates uniform in [-0.1, 0.1]."""
        draw = torch.rand(len(theta), 4, dtype=theta.dtype, device=theta.device, generator=generator)
        q, v = (0.2 * draw - 0.1).split(2, dim=-1)
        return TensorDict({"qpos": q, "qvel": v}, batch_size=(len(theta),), device=theta.device)

    def observe(self, state: TensorDictBase) -> Float[Tensor, "N 6"]:
        """See the class."""
        q = state.get("qpos")
        turned = torch.stack((q.cos(), q.sin()), dim=-1).flatten(-2)
        return torch.cat((turned, state.get("qvel")), dim=-1).to(torch.float32)

    def command(self, action: Tensor) -> Float[Tensor, "N 1"]:
        """The torque [N m]."""
        return (action[..., 2:] - action[..., :1]).to(torch.float64)

    def reward(self, state: TensorDictBase, action: Tensor, after: TensorDictBase) -> Float[Tensor, " N"]:
        """Minus one, zero for the step that arrives."""
        return self.terminated(after).to(torch.float32) - 1

    def terminated(self, state: TensorDictBase) -> Bool[Tensor, " N"]:
        """The tip is high enough."""
        first, second = state.get("qpos").unbind(-1)
        return -torch.cos(first) - torch.cos(first + second) > 1
