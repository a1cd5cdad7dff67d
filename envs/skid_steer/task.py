r"""Drive along a circle at a constant speed.

    cost = 10 d^2 + 10 (v - 0.15)^2        d = |p| - 1 distance to the circle [m], v forward speed [m/s]

The thesis (section 5.4.3) gives neither cost nor radius nor speed: these are ours. The forward speed stands in it, not
that of the tracked point: a robot whose centre of rotation is displaced could give its origin any speed by spinning.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Bounded

from envs.skid_steer import picture
from envs.skid_steer.kinematics import MAX_WHEEL_SPEED
from onlinebayes.simulators import Shape, Task


class CircleTask(Task):
    """Follow the circle around the origin anticlockwise, for 20 s at 10 Hz; reward minus the cost, see the module.

    Observation: x, y [m], yaw [rad], not wrapped. Action: speeds of the right and the left wheels [rad/s].

    Args:
        radius: of the circle [m].
        speed: wanted forward speed [m/s].
        horizon: steps of an episode.
    """

    observation_size = 3
    channels: Mapping[str, Mapping[str, str]] = {
        "observation": {"x": "m", "y": "m", "yaw": "rad"},
        "action": {"right wheels": "rad/s", "left wheels": "rad/s"},
    }

    def __init__(self, radius: float = 1.0, speed: float = 0.15, horizon: int = 200) -> None:
        self.radius, self.speed, self.horizon = radius, speed, horizon
        self.action_spec = Bounded(-MAX_WHEEL_SPEED, MAX_WHEEL_SPEED, shape=(2,), dtype=torch.float32)

    def start(self, theta: Float[Tensor, "n P"], generator: torch.Generator) -> TensorDict:
        """On the circle, heading along it, at rest."""
        pose = theta.new_tensor((self.radius, 0.0, math.pi / 2)).expand(len(theta), -1).clone()
        parts = {"qpos": pose, "qvel": torch.zeros_like(pose)}
        return TensorDict(parts, batch_size=(len(theta),), device=theta.device)

    def observe(self, state: TensorDictBase) -> Float[Tensor, "N 3"]:
        """The pose."""
        return state.get("qpos").to(torch.float32)

    def command(self, action: Tensor) -> Float[Tensor, "N 2"]:
        """The wheels' speeds [rad/s]; the simulator cuts them off."""
        return action

    def cost(self, after: TensorDictBase) -> Float[Tensor, "*batch"]:
        """Of the steps that ended in these states (*batch); see the module."""
        x, y, _ = after.get("qpos").unbind(-1)
        distance = torch.hypot(x, y) - self.radius
        return 10.0 * (distance.square() + (after.get("qvel")[..., 0] - self.speed).square())

    def reward(self, state: TensorDictBase, action: Tensor, after: TensorDictBase) -> Float[Tensor, " N"]:
        """Minus the cost."""
        return -self.cost(after)

    def terminated(self, state: TensorDictBase) -> Bool[Tensor, " N"]:
        """Never."""
        return torch.zeros(state.batch_size, dtype=torch.bool, device=state.device)

    def shapes(self, theta: Float[Tensor, " P"]) -> tuple[Shape, ...]:
        """The circle."""
        return (picture.ring(self.radius),)

    def poses(self, theta: Float[Tensor, " P"], states: TensorDictBase) -> Float[Tensor, "T 1 7"]:
        """Around the origin; see :class:`~onlinebayes.simulators.Drawable`."""
        return picture.at_origin(states.get("qpos"))
