"""Blocks of windows, and everything that follows from leaving one out: no new simulation, only normal equations.

    theta_-b = theta + argmin over steps of sum_{w in train(b)} |r~_w - C~_w d|^2      within the bounds
    r~_w(theta_-b) = r~_w - C~_w (theta_-b - theta)                                    for the test windows w of block b

One run is one block where there are at least 7 fit runs; else B = min(12, floor(T / max(H, 4 tau))) contiguous blocks
with a gap of one window between training and test. tau is the correlation time within windows whose starts are
projected out, so that a slow misfit reaches a third of the window at most.

The significance test flips signs of smaller groups, whole windows of max(H, 4 tau) together, at most 24: under a gross
misfit the flipped residual still holds the effect, and the fewer the groups, the more of it (with 8 it hid payloads).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from scipy.special import stdtrit
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.fit import Fit
from onlinebayes.identification.fitting.projection import Projected
from onlinebayes.identification.replaying.bounded import bounded_least_squares

FEWEST_BLOCKS = 7
"""Fewer independent blocks do not tell a law from chance; so many runs are blocks of their own."""

MOST_BLOCKS = 12
"""Runs are cut into so many blocks at most."""

MOST_GROUPS = 24
"""The significance test flips the signs of so many groups of windows at most."""

BLOCK_CORRELATION_TIMES = 4.0
"""Parts of the data that last so many correlation times of the residual count as independent."""


@dataclass(frozen=True)
class Blocks:
    """B blocks of W windows.

    Args:
        of: block of each window.
        train: which windows may be used for training when a block is tested.
    """

    of: Int[Tensor, " W"]
    train: Bool[Tensor, "B W"]

    @property
    def count(self) -> int:
        """B."""
        return self.train.shape[0]

    def sums(self, per_window: Float[Tensor, "W ..."]) -> Float[Tensor, "B ..."]:
        """Sum over the windows of each block."""
        out = per_window.new_zeros(self.count, *per_window.shape[1:])
        return out.index_add(0, self.of, per_window)


def make_blocks(windows: Windows, tau: float, folds: int | None = None) -> Blocks:
    """Blocks of the fit windows.

    Args:
        windows: the fit windows.
        tau: correlation time of the current residual [s].
        folds: number of blocks asked for, or None; more than the data allow are not made.
    """
    moving = windows.moving
    runs = torch.unique(windows.run[moving])
    W = windows.count
    if len(runs) >= FEWEST_BLOCKS and (folds is None or folds >= len(runs)):
        of = torch.searchsorted(runs, windows.run.contiguous()).clamp_max(len(runs) - 1)
        train = of[None] != torch.arange(len(runs), device=of.device)[:, None]
        return Blocks(of, train)
    duration = float(moving.sum()) * windows.horizon
    possible = min(
        MOST_BLOCKS if folds is None else folds,
        int(duration / max(windows.horizon, BLOCK_CORRELATION_TIMES * tau) + 1e-9),
    )
    B = max(1, min(possible, W))
    # Windows are shared out by how many of those before them hold an observation.
    order = moving.cumsum(0) - moving.long()
    of = (order * B // max(int(moving.sum()), 1)).clamp_max(B - 1)
    if len(runs) >= FEWEST_BLOCKS:  # fewer folds than runs: whole runs together
        rank = torch.searchsorted(runs, windows.run.contiguous()).clamp_max(len(runs) - 1)
        of = rank * B // len(runs)
        return Blocks(of, of[None] != torch.arange(B, device=of.device)[:, None])
    train = of[None] != torch.arange(B, device=of.device)[:, None]
    for b in range(B):
        test = of == b
        beside = torch.zeros_like(test)
        beside[1:] |= test[:-1] & (windows.run[1:] == windows.run[:-1])
        beside[:-1] |= test[1:] & (windows.run[1:] == windows.run[:-1])
        train[b] &= ~beside
    return Blocks(of, train)


def flip_groups(windows: Windows, tau: float) -> Int[Tensor, " W"]:
    """Number of the group of each window, for the significance test; counted from 0, none empty.

    Args:
        windows: the fit windows.
        tau: correlation time of the current residual [s].
    """
    moving = windows.moving
    together = max(1, math.ceil(BLOCK_CORRELATION_TIMES * tau / windows.horizon - 1e-9))
    count = max(1, min(MOST_GROUPS, int(moving.sum()) // together))
    order = moving.cumsum(0) - moving.long()
    return (order * count // max(int(moving.sum()), 1)).clamp_max(count - 1)


def independent_parts(windows: Windows, tau: float, folds: int | None = None) -> int:
    """How many parts of the data may be called independent: the fewer of blocks and of groups whose signs flip.

    Eight runs are eight blocks, however slow the misfit; but where it is so slow that they make five groups, no flip
    could ever be rare enough (2 / 2^5 = .06).

    Args:
        windows: the fit windows.
        tau: correlation time of the current residual [s].
        folds: number of blocks asked for, or None.
    """
    return min(make_blocks(windows, tau, folds).count, int(flip_groups(windows, tau).max()) + 1)


def leave_one_out(fitted: Fit, blocks: Blocks, whole: bool = False) -> Float[Tensor, "B P"]:
    """theta_-b for every block, within the bounds.

    Args:
        fitted: the fit to all windows.
        blocks: the blocks.
        whole: leave out the block alone, without its gap (for the jackknife).
    """
    C, r = fitted.projected.columns, fitted.projected.residual
    normal, gradient = C.mT @ C, (C.mT @ r[..., None])[..., 0]
    space, theta = fitted.simulator.parameters, fitted.theta
    low, high = space.low.to(theta) - theta, space.high.to(theta) - theta
    if not len(theta):
        return theta.new_zeros(blocks.count, 0)
    rows = []
    for b in range(blocks.count):
        keep = (blocks.of != b) if whole else blocks.train[b]
        N, g = normal[keep].sum(0), gradient[keep].sum(0)
        rows.append(theta + bounded_least_squares(N, g, low, high))
    return torch.stack(rows)


def held_out_rows(
    projected: Projected, theta: Float[Tensor, " P"], without: Float[Tensor, "B P"]
) -> Float[Tensor, "B V m"]:
    """Every window's projected residual under each theta_-b (test and training windows alike)."""
    step = without - theta
    return projected.residual[None] - torch.einsum("vmp,bp->bvm", projected.columns, step)


def jackknife(without: Float[Tensor, "B P"]) -> Float[Tensor, "P P"]:
    """Covariance of theta: (B - 1) / B sum_b (theta_-b - mean)(theta_-b - mean)'."""
    B = without.shape[0]
    away = without - without.mean(0)
    return (B - 1) / B * away.T @ away


def t_quantile(level: float, blocks: int) -> float:
    """Quantile of Student's t with B - 1 degrees of freedom."""
    return float(stdtrit(max(blocks - 1, 1), level))
