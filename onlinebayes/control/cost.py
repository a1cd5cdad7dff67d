"""Costs that a planner minimises: a cost of every step, or minus the reward of a task."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, cast, runtime_checkable

import torch
from jaxtyping import Float
from tensordict import TensorDictBase
from torch import Tensor

from onlinebayes.simulators import Task


@runtime_checkable
class Cost(Protocol):
    """Cost of steps, for whole rollouts at once."""

    def __call__(
        self, before: TensorDictBase, action: Float[Tensor, "M H U"], after: TensorDictBase
    ) -> Float[Tensor, "M H"]:
        """Cost of each step from ``before`` to ``after``, both of batch size (M, H), under an action."""


@dataclass(frozen=True)
class TaskCost:
    """Minus the reward of a task; nothing after a state that ends the episode.

    Args:
        task: whose reward it is.
    """

    task: Task

    def __call__(
        self, before: TensorDictBase, action: Float[Tensor, "M H U"], after: TensorDictBase
    ) -> Float[Tensor, "M H"]:
        """See :class:`Cost`."""
        shape = action.shape[:2]
        before, after = (cast(TensorDictBase, each.reshape(-1)) for each in (before, after))
        reward = self.task.reward(before, action.reshape(-1, action.shape[-1]), after).reshape(shape)
        ended = self.task.terminated(after).reshape(shape)
        over = ended.cumsum(1) - ended.long() > 0
        return torch.where(over, torch.zeros_like(reward), -reward)
