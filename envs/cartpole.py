r"""CartPole: a pole on a cart, balanced by pushing the cart left or right.

    a_x     = y - s a_phi
    a_phi   = (g sin(phi) + t / (m l) - y cos(phi)) / (4/3 l - s cos(phi))
    y       = (f + m l w^2 sin(phi)) / (m_c + m),   s = m l cos(phi) / (m_c + m)

x position of the cart [m], phi angle of the pole from upright [rad], w = d phi/dt, l half the pole's length, f and t
force on the cart and torque on the pole. The same system, step and limits as Gymnasium's ``CartPole-v1`` (Barto, Sutton
and Anderson 1983; the equations after Florian 2007), with a torque on the pole added for effects.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import OneHot

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators import Actuator, Joint, Task, TorchSimulator
from onlinebayes.simulators.drawing import BLUE, DARK, GREY, Shape, planar
from onlinebayes.simulators.stepping import Integrator


class CartPole(TorchSimulator):
    """Batched cart-pole with Gymnasium's parameters.

    ``length`` is **half** the pole's length (as in Gymnasium), ``mass`` the pole's; the command +1 or -1 pushes with
    ``force``.
    """

    physical = ParameterSpace(
        {
            "length": Parameter(0.01, 10.0, "m", "log"),
            "mass": Parameter(0.001, 10.0, "kg", "log"),
            "masscart": Parameter(0.01, 100.0, "kg", "log"),
            "gravity": Parameter(0.0, 30.0, "m/s2"),
            "force": Parameter(0.0, 100.0, "N"),
        }
    )
    defaults = {"length": 0.5, "mass": 0.1, "masscart": 1.0, "gravity": 9.8, "force": 10.0}  # noqa: RUF012
    joints = (Joint("cart", "slide"), Joint("pole", "hinge"))
    actuators = (Actuator("motor", "cart", gear="force", limit=1.0),)
    timestep = 0.02
    integrator: ClassVar[Integrator] = "explicit"

    def acceleration(
        self,
        parameters: Mapping[str, Float[Tensor, " N"]],
        q: Float[Tensor, "J N"],
        v: Float[Tensor, "J N"],
        tau: Float[Tensor, "J N"],
    ) -> Float[Tensor, "J N"]:
        """Accelerations of cart [m/s^2] and pole [rad/s^2]; see the module."""
        length, mass = parameters["length"], parameters["mass"]
        total, moment = mass + parameters["masscart"], mass * length
        sin, cos = torch.sin(q[1]), torch.cos(q[1])
        share = moment / total * cos
        push = (tau[0] + moment * v[1].square() * sin) / total
        turn = (parameters["gravity"] * sin + tau[1] / moment - cos * push) / (4.0 / 3.0 * length - share * cos)
        return torch.stack((push - share * turn, turn))

    def shapes(self, theta: Float[Tensor, " P"]) -> tuple[Shape, ...]:
        """Track, cart, and a pole of its true length."""
        length = float(self._named(theta)["length"])
        return (
            Shape("track", "plane", (2.4, 0.15, 0.01), GREY, moving=False),
            Shape("cart", "box", (0.22, 0.12, 0.1), DARK),
            Shape("pole", "capsule", (min(0.04, 0.1 * length), length), BLUE),
            Shape("axle", "sphere", (0.03,), GREY),
        )

    def poses(self, theta: Float[Tensor, " P"], states: TensorDictBase) -> Float[Tensor, "T 4 7"]:
        """See :class:`~onlinebayes.simulators.Drawable`."""
        length, (x, angle) = float(self._named(theta)["length"]), states.get("qpos").unbind(-1)
        zero = torch.zeros_like(x)
        track, cart, axle = planar(zero, zero - 0.11, zero), planar(x, zero, zero), planar(x, zero, zero, -0.18)
        pole = planar(x + length * torch.sin(angle), length * torch.cos(angle), angle, -0.16)
        return torch.stack((track, cart, pole, axle), dim=1)


class CartPoleTask(Task):
    """Keep the pole up: reward 1 a step until the pole leaves 12 degrees or the cart 2.4 m; 500 steps at most.

    Observation (x, dx/dt, phi, d phi/dt); action one-hot of (left, right).

    Args:
        horizon: steps of an episode.
    """

    observation_size = 4
    channels: Mapping[str, Mapping[str, str]] = {
        "observation": {"position": "m", "velocity": "m/s", "angle": "rad", "rate": "rad/s"},
        "action": {"push left": "", "push right": ""},
    }
    max_position = 2.4  # [m]
    max_angle = 12 * 2 * math.pi / 360  # [rad]
    spread = 0.05  # of each coordinate at the start, uniform around zero

    def __init__(self, horizon: int = 500) -> None:
        self.horizon = horizon
        self.action_spec = OneHot(2, dtype=torch.int64)

    def start(self, theta: Float[Tensor, "n P"], generator: torch.Generator) -> TensorDict:
        """Every coordinate uniform in [-0.05, 0.05]."""
        draws = torch.rand(len(theta), 4, dtype=theta.dtype, device=theta.device, generator=generator)
        q, v = ((2 * draws - 1) * self.spread).split(2, dim=-1)
        return TensorDict({"qpos": q, "qvel": v}, batch_size=(len(theta),), device=theta.device)

    def observe(self, state: TensorDictBase) -> Float[Tensor, "N 4"]:
        """(x, dx/dt, phi, d phi/dt) [m, m/s, rad, rad/s]."""
        (x, angle), (speed, rate) = state.get("qpos").unbind(-1), state.get("qvel").unbind(-1)
        return torch.stack((x, speed, angle, rate), dim=0).to(torch.float32).movedim(0, -1)

    def command(self, action: Tensor) -> Float[Tensor, "N 1"]:
        """+1 for right, -1 for left."""
        return 2.0 * action[..., 1:] - 1.0

    def reward(self, state: TensorDictBase, action: Tensor, after: TensorDictBase) -> Float[Tensor, " N"]:
        """One, also for the step that fails."""
        return torch.ones(state.batch_size, dtype=torch.float32, device=state.device)

    def terminated(self, state: TensorDictBase) -> Bool[Tensor, " N"]:
        """The cart left 2.4 m or the pole 12 degrees."""
        position, angle = state.get("qpos").abs().unbind(-1)
        return (position > self.max_position) | (angle > self.max_angle)
