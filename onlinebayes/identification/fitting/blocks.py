"""Blocks of windows, and everything that follows from leaving one out: no new simulation, only normal equations.

    theta_-b = theta + argmin over d of sum_{w not in b} |r~_w - C~_w d|^2      within the bounds

One run is one block where there are at least 7 fit runs; else B = min(12, floor(T / max(H, 4 tau))) contiguous blocks.
tau is the correlation time within windows whose starts are projected out, so that a slow misfit reaches a third of the
window at most.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from scipy.special import stdtrit
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.fit import Fit
from onlinebayes.identification.replaying.bounded import bounded_least_squares

FEWEST_BLOCKS = 7
"""Fewer independent blocks do not tell a law from chance; so many runs are blocks of their own."""

MOST_BLOCKS = 12
"""Runs are cut into so many blocks at most."""

BLOCK_CORRELATION_TIMES = 4.0
"""Parts of the data that last so many correlation times of the residual count as independent."""


@dataclass(frozen=True)
class Blocks:
    """B = ``count`` blocks of W windows; ``of`` is the block of each."""

    of: Int[Tensor, " W"]
    count: int


def make_blocks(windows: Windows, tau: float, folds: int | None = None) -> Blocks:
    """Blocks of the fit windows.

    Args:
        windows: the fit windows.
        tau: correlation time of the current residual [s].
        folds: number of blocks asked for, or None; more than the data allow are not made.
    """
    moving = windows.moving
    runs = torch.unique(windows.run[moving])
    rank = torch.searchsorted(runs, windows.run.contiguous()).clamp_max(len(runs) - 1)
    if len(runs) >= FEWEST_BLOCKS and (folds is None or folds >= len(runs)):
        return Blocks(rank, len(runs))
    duration = float(moving.sum()) * windows.horizon
    possible = min(
        MOST_BLOCKS if folds is None else folds,
        int(duration / max(windows.horizon, BLOCK_CORRELATION_TIMES * tau) + 1e-9),
    )
    count = max(1, min(possible, windows.count))
    if len(runs) >= FEWEST_BLOCKS:  # fewer folds than runs: whole runs together
        return Blocks(rank * count // len(runs), count)
    # Windows are shared out by how many of those before them hold an observation.
    order = moving.cumsum(0) - moving.long()
    return Blocks((order * count // max(int(moving.sum()), 1)).clamp_max(count - 1), count)


def leave_one_out(fitted: Fit, blocks: Blocks) -> Float[Tensor, "B P"]:
    """theta_-b for every block of a fit to all windows, within the bounds."""
    C, r = fitted.projected.columns, fitted.projected.residual
    normal, gradient = C.mT @ C, (C.mT @ r[..., None])[..., 0]
    space, theta = fitted.simulator.parameters, fitted.theta
    low, high = space.low.to(theta) - theta, space.high.to(theta) - theta
    if not len(theta):
        return theta.new_zeros(blocks.count, 0)
    rows = []
    for b in range(blocks.count):
        keep = blocks.of != b
        N, g = normal[keep].sum(0), gradient[keep].sum(0)
        rows.append(theta + bounded_least_squares(N, g, low, high))
    return torch.stack(rows)


def jackknife(without: Float[Tensor, "B P"]) -> Float[Tensor, "P P"]:
    """Covariance of theta: (B - 1) / B sum_b (theta_-b - mean)(theta_-b - mean)'."""
    B = without.shape[0]
    away = without - without.mean(0)
    return (B - 1) / B * away.T @ away


def t_quantile(level: float, blocks: int) -> float:
    """Quantile of Student's t with B - 1 degrees of freedom."""
    return float(stdtrit(max(blocks - 1, 1), level))
