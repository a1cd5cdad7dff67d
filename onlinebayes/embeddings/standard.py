"""Summaries of trajectories on one scale: standardised, straight in the middle, logarithmic in the tails.

e = 3 asinh((x - mean) / 3 sd)
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

STRAIGHT = 3.0
"""Standard deviations up to which a summary is passed on straight."""


class Standard(nn.Module):
    """x (..., E) -> e; mean and standard deviation are buffers, set by :meth:`fit`.

    Args:
        size: E.
    """

    centre: Tensor
    spread: Tensor

    def __init__(self, size: int) -> None:
        super().__init__()
        self.register_buffer("centre", torch.zeros(size, dtype=torch.float64))
        self.register_buffer("spread", torch.ones(size, dtype=torch.float64))

    def fit(self, x: Float[Tensor, "B E"]) -> None:
        """Set them from the summaries of B trajectories; one that does not vary gives zero from now on."""
        spread, centre = torch.std_mean(x, dim=0, correction=0)
        self.centre.copy_(centre)
        self.spread.copy_(torch.where(spread <= 1e-9 * x.abs().amax(0).clamp(min=1e-30), torch.inf, spread))

    def forward(self, x: Float[Tensor, "*batch E"]) -> Float[Tensor, "*batch E"]:
        """e."""
        return STRAIGHT * torch.asinh((x - self.centre) / self.spread / STRAIGHT)
