"""Spread of a score by what the machine has and the model lacks, noise or not: Sigma of :mod:`.score`.

    Sigma = (K c Sigma_0 + (B* - 1) V) / nu,     V = (B - 1) / B sum_b (t_b - mean)(t_b - mean)',      nu = K + B* + 1
    Sigma_0 = tau / Delta sum_i r_i^2 U_i U_i',  c = max(1, level of V over Sigma_0),                  A_b = U_b' U_b
    t_b = (1 - A_b)^-1 U_b' r_b,                 B* = least over k of 1 / sum_b A_b[k, k]^2

t_b is by how much the score's optimum moves without a block: V is the jackknife, as that of the fit's own intervals. A
block that has much of what is known (A_b near 1) is fitted closely, whatever its error, and few such blocks say little
of the error: B* counts them. K blocks' worth of a residual that is stationary, with correlation time tau, stand beside
them (Delta: a bin; White 1980). The inverse Wishart prior makes the score Student's with nu degrees of freedom, which
pays for estimating Sigma from few blocks (Bell and McCaffrey 2002; Sellentin and Heavens 2016).

A model that errs by place errs alike in every block of time, which no difference between blocks shows: where the alarm
rings, the truth can lie many of these errors away (``docs/limits.md``).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.identification import Windows, make_blocks

MOST_LEVERAGE = 0.9
"""Share of what is known that one block can have: its part in the score is not made more than ten times as large."""


@dataclass(frozen=True, eq=False)
class Spread:
    """Sigma and nu.

    Args:
        scale: Sigma.
        freedom: nu.
        blocks: B*.
    """

    scale: Float[Tensor, "K K"]
    freedom: float
    blocks: float


def spread_of(
    parts: Parts,
    stationary: Float[Tensor, "K K"],
    windows: Windows,
    tau: float,
    folds: int | None = None,
    runs_differ: bool = False,
) -> Spread:
    """Estimate them.

    Args:
        parts: each window's in the score.
        stationary: Sigma_0.
        windows: the data.
        tau: correlation time of the residual [s].
        folds: number of blocks asked for.
        runs_differ: whether runs have values of their own. Then each window is a block, for a run in one block would
            say nothing of its own value's error.
    """
    if not len(stationary):
        return Spread(stationary, 1.0, 1.0)
    of = torch.arange(windows.count, device=windows.run.device) if runs_differ else make_blocks(windows, tau, folds).of
    return pooled(*parts.jackknife(of), stationary)


@dataclass(frozen=True, eq=False)
class Parts:
    """Of each window in the score and in what is known.

    Args:
        score: U_w' r_w.
        known: A_w.
    """

    score: Float[Tensor, "W K"]
    known: Float[Tensor, "W K K"]

    def jackknife(self, of: Int[Tensor, " W"]) -> tuple[Float[Tensor, "K K"], float]:
        """V and B* of windows in blocks; zero and 1 for a single block."""
        B, score, known = self._in(of)
        if B < 2:
            return known[0] * 0, 1.0
        share, vectors = torch.linalg.eigh(known)
        inside = torch.einsum("bki,bk->bi", vectors, score) / (1 - share.clamp_max(MOST_LEVERAGE))
        moved = torch.einsum("bki,bi->bk", vectors, inside)
        away = moved - moved.mean(0)
        return away.T @ away * ((B - 1) / B), _worth(known)

    def _in(self, of: Int[Tensor, " W"]) -> tuple[int, Float[Tensor, "B K"], Float[Tensor, "B K K"]]:
        B = int(of.max()) + 1
        score, known = (x.new_zeros(B, *x.shape[1:]).index_add(0, of, x) for x in (self.score, self.known))
        return B, score, known


def _worth(known: Float[Tensor, "B K K"]) -> float:
    """B*."""
    return float((1 / known.diagonal(dim1=1, dim2=2).square().sum(0)).min())


def pooled(spread: Float[Tensor, "K K"], blocks: float, stationary: Float[Tensor, "K K"]) -> Spread:
    """Sigma and nu from V, B* and Sigma_0."""
    K = len(stationary)
    total = K * max(level(spread, stationary), 1.0) * stationary + (blocks - 1) * spread
    # A score that nothing moves would have no density.
    least = 1e-12 * total.diagonal().mean().clamp_min(1e-300) * torch.eye(K).to(total)
    freedom = K + blocks + 1.0
    return Spread((total + least) / freedom, freedom, blocks)


def level(spread: Float[Tensor, "K K"], stationary: Float[Tensor, "K K"]) -> float:
    """Mean over directions of one spread as a multiple of the other."""
    return float((torch.linalg.pinv(stationary, hermitian=True) @ spread).diagonal().mean())
