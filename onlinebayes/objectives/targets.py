"""Target networks: copies that follow slowly, theta' <- theta' + tau (theta - theta'), all tensors in one call."""

from __future__ import annotations

import copy
from typing import Generic, TypeVar

import torch
from torch import Tensor, nn

Followed = TypeVar("Followed", bound=nn.Module)


class Follower(Generic[Followed]):
    """A copy of a network that follows it.

    Args:
        network: followed.
        tau: share of the gap that a step closes.

    Attributes:
        network: the copy; it learns nothing itself.
    """

    def __init__(self, network: Followed, tau: float) -> None:
        if not 0 < tau <= 1:
            raise ValueError(f"tau = {tau}: needs 0 < tau <= 1")
        self.network: Followed = copy.deepcopy(network).requires_grad_(False)
        self.tau = tau
        self._ahead: list[Tensor] = list(network.parameters())
        self._behind: list[Tensor] = list(self.network.parameters())

    @torch.no_grad()
    def step(self) -> None:
        """Follow."""
        torch._foreach_lerp_(self._behind, self._ahead, self.tau)
