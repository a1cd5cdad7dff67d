r"""Swing a pole up by pushing its cart, and hold it there.

    reward = -( 1 - cos(phi) + 0.1 x^2 + 0.01 w^2 + 0.01 u^2 ),      x cart [m], phi pole from upright [rad], w its rate

for any cart-pole whose state is ``qpos`` (x, phi) and ``qvel`` and whose command u in [-1, 1] pushes the cart. The pole
hangs at the start. Nothing ends the episode: a reward below zero that could be ended would teach to end it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Bounded

from onlinebayes.simulators import Task


class SwingUpTask(Task):
    """Swing up and hold; see the module.

    Observation (x, dx/dt, cos phi, sin phi, d phi/dt); action the push in [-1, 1], in parts of the greatest.

    Args:
        horizon: steps of an episode.
    """

    observation_size = 5
    channels: Mapping[str, Mapping[str, str]] = {
        "observation": {"position": "m", "velocity": "m/s", "cos angle": "", "sin angle": "", "rate": "rad/s"},
        "action": {"push": "of the greatest"},
    }
    spread = 0.1  # of each coordinate at the start, uniform around the pole hanging at rest [m, rad, m/s, rad/s]

    def __init__(self, horizon: int = 125) -> None:
        self.horizon = horizon
        self.action_spec = Bounded(-1.0, 1.0, shape=(1,), dtype=torch.float32)

    def start(self, theta: Float[Tensor, "n P"], generator: torch.Generator) -> TensorDict:
        """Near the pole hanging at rest in the middle."""
        draws = torch.rand(len(theta), 4, dtype=theta.dtype, device=theta.device, generator=generator)
        q, v = ((2 * draws - 1) * self.spread).split(2, dim=-1)
        return TensorDict(
            {"qpos": q + q.new_tensor([0.0, math.pi]), "qvel": v}, batch_size=(len(theta),), device=theta.device
        )

    def observe(self, state: TensorDictBase) -> Float[Tensor, "N 5"]:
        """(x, dx/dt, cos phi, sin phi, d phi/dt) [m, m/s, 1, 1, rad/s]."""
        (x, angle), (speed, rate) = state.get("qpos").unbind(-1), state.get("qvel").unbind(-1)
        return torch.stack((x, speed, angle.cos(), angle.sin(), rate), dim=-1).to(torch.float32)

    def command(self, action: Tensor) -> Float[Tensor, "N 1"]:
        """The push, in parts of the greatest; the simulator cuts it off."""
        return action

    def reward(self, state: TensorDictBase, action: Tensor, after: TensorDictBase) -> Float[Tensor, " N"]:
        """See the module; of the state after the step."""
        (x, angle), rate = after.get("qpos").unbind(-1), after.get("qvel")[..., 1]
        effort = action[..., 0].to(x.dtype).clamp(-1, 1)
        return -(1 - angle.cos() + 0.1 * x.square() + 0.01 * rate.square() + 0.01 * effort.square())

    def terminated(self, state: TensorDictBase) -> Bool[Tensor, " N"]:
        """Never."""
        return torch.zeros(state.batch_size, dtype=torch.bool, device=state.device)


def state_of(observation: Float[Tensor, "M 5"]) -> TensorDict:
    """The state behind an observation, the angle within [-pi, pi]."""
    x, speed, cos, sin, rate = observation.double().unbind(-1)
    qpos = torch.stack((x, torch.atan2(sin, cos)), dim=-1)
    return TensorDict({"qpos": qpos, "qvel": torch.stack((speed, rate), dim=-1)}, batch_size=observation.shape[:1])
