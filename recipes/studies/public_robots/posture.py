"""A task for any arm of servos: go to a posture and stay there.

r = 1 - mean_j |q_j - goal_j| / 0.3 rad
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Generator, Tensor
from torchrl.data import Bounded

from onlinebayes.simulators import Task

REACH = 0.3
"""How far postures are from home, and by how much a servo may be told to move at most [rad, or rad/s]."""


class Posture(Task):
    """Postures within 0.3 rad of home, for an arm with J joints; an episode has 50 steps.

    Args:
        home: posture [rad].
        speeds: whether servos take speeds; else positions.
    """

    horizon = 50

    def __init__(self, home: tuple[float, ...], speeds: bool) -> None:
        self.home, self.speeds = torch.tensor(home), speeds
        self.observation_size = 2 * len(home)
        self.action_spec = Bounded(-1, 1, (len(home),), dtype=torch.float32)

    def start(self, theta: Float[Tensor, "n P"], generator: Generator) -> TensorDict:
        """Anywhere near home, at rest."""
        shape = (2, len(theta), len(self.home))
        about = 2 * torch.rand(shape, generator=generator, dtype=theta.dtype, device=theta.device) - 1
        q, goal = self.home.to(theta) + REACH * about
        return TensorDict(
            {"qpos": q, "qvel": torch.zeros_like(q), "task": TensorDict({"goal": goal}, [len(theta)])}, [len(theta)]
        )

    def observe(self, state: TensorDictBase) -> Float[Tensor, "N O"]:
        """How far away the goal is [0.3 rad], and the speeds [rad/s]."""
        return torch.cat([(state["task", "goal"] - state["qpos"]) / REACH, state["qvel"]], dim=-1).float()

    def command(self, action: Tensor) -> Float[Tensor, "N J"]:
        """Where to be, or how fast to go there."""
        return REACH * action * (2 if self.speeds else 1) + (0 if self.speeds else self.home.to(action))

    def reward(self, state: TensorDictBase, action: Tensor, after: TensorDictBase) -> Float[Tensor, " N"]:
        """1 at the goal."""
        del state, action
        return 1 - (after["qpos"] - after["task", "goal"]).abs().mean(-1) / REACH

    def terminated(self, state: TensorDictBase) -> Bool[Tensor, " N"]:
        """Never."""
        return torch.zeros(state.batch_size, dtype=torch.bool, device=state["qpos"].device)
