"""Exploration by a deterministic policy.

    with probability epsilon   a ~ U(low, high)
    else                       a = clip(pi(s) + sigma (high - low) / 2 N(0, 1), low, high)

Andrychowicz et al., Hindsight Experience Replay (2017).
"""

from __future__ import annotations

from typing import final

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torchrl.envs.utils import ExplorationType, exploration_type


@final
class Exploration(nn.Module):
    """Disturb an action under ``ExplorationType.RANDOM`` only, which collectors set.

    Args:
        low, high: the action's bounds (A,).
        epsilon: probability of a uniformly random action.
        noise: standard deviation of what is added otherwise, in half widths of the bounds.
    """

    low: Tensor
    high: Tensor

    def __init__(
        self, low: Float[Tensor, " A"], high: Float[Tensor, " A"], epsilon: float = 0.3, noise: float = 0.2
    ) -> None:
        super().__init__()
        self.register_buffer("low", low.clone(), persistent=False)
        self.register_buffer("high", high.clone(), persistent=False)
        self.epsilon, self.noise = epsilon, noise

    def forward(self, action: Float[Tensor, "*batch A"]) -> Float[Tensor, "*batch A"]:
        """An action within the bounds."""
        if exploration_type() is not ExplorationType.RANDOM:
            return action
        width = self.high - self.low
        near = action + self.noise * width / 2 * torch.randn_like(action)
        anywhere = self.low + width * torch.rand_like(action)
        at_random = torch.rand_like(action[..., :1]) < self.epsilon
        return torch.where(at_random, anywhere, near.clamp(self.low, self.high))
