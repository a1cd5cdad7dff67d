"""Which candidates could explain the residual: a score test for all of them at once, calibrated by flipping blocks.

    c~  the candidate's sensitivity, projected off the starts and the fitted parameters (P their projector)
    r   the residual, its scale s
    z = sum_b g_b / (s |c~|),     g_b = sum over block b of c~ r
    under the flips F = diag(+-1 per block):    z_F = sum_b +-g_b / (s sqrt(c~' F (I - P) F c~))
    p = share of the flips whose largest z_F, over all candidates of no higher z, starting values and horizons,
        reaches z; at least the p of every candidate of higher z

One-sided for candidates bounded on one side, abs(z) else. The scale s is the RMS of the residual; it cancels within a
horizon. A candidate with |c~|^2 < 1e-3 |c|^2 moves nothing that the free parameters cannot: it is confounded.
Randomisation over blocks needs no model of the correlation within them (Westfall and Young 1993, the step-down max-T
test: with nothing missing the smallest p is that of the maximum over all candidates, and so is the false alarm rate;
what only ranks below another is not held to that one's flips, which a gross misfit of both makes large). Up
to 12 blocks all 2^B flips are taken, else 4096 drawn ones, the identity among them (Phipson and Smyth 2010).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.identification.fitting.projection import Projected

CONFOUNDED = 1e-3
ALL_FLIPS = 12  # blocks


@dataclass(frozen=True)
class Column:
    """Whose column of the test it is, and which signs are physical; a candidate has one for each of its trials.

    Args:
        candidate: index of the candidate.
        two_sided: whether its size may be negative.
    """

    candidate: int
    two_sided: bool


@dataclass(frozen=True)
class Scores:
    """Per-block ingredients of the test at one horizon, for C columns and B blocks.

    Args:
        g: g_b of each column.
        h: Q' c~ per block, Q an orthonormal basis of the fitted sensitivities.
        norm: |c~|^2.
        share: |c~|^2 / |c|^2.
        scale: s.
        misfit: |r|^2, r off the fitted sensitivities.
        size: the least-squares size g / |c~|^2, in units of the column's finite difference.
        loads: coefficients of each column on the fitted sensitivities.
    """

    g: Float[Tensor, "B C"]
    h: Float[Tensor, "B Q C"]
    norm: Float[Tensor, " C"]
    share: Float[Tensor, " C"]
    scale: float
    misfit: float
    size: Float[Tensor, " C"]
    loads: Float[Tensor, "Q C"]


def block_scores(
    projected: Projected, candidates: Float[Tensor, "V m C"], of: Int[Tensor, " V"], blocks: int
) -> Scores:
    """The ingredients at one horizon.

    Args:
        projected: residual and fitted columns, starts projected out.
        candidates: the candidates' columns, starts projected out.
        of: block of each window (or piece).
        blocks: B.
    """
    V, m, C = candidates.shape
    P = projected.columns.shape[-1]
    Q = orthonormal(projected.columns.reshape(V * m, P))
    c = candidates.reshape(V * m, C)
    loads = Q.T @ c
    tilde = c - Q @ loads
    r = projected.residual.reshape(V * m)
    r = r - Q @ (Q.T @ r)

    # r and Q side by side, times c~ window by window: their products row by row would be m Q times as large.
    by_window = torch.cat([r[:, None], Q], dim=1).reshape(V, m, -1).mT @ tilde.reshape(V, m, C)
    by_block = by_window.new_zeros(blocks, *by_window.shape[1:]).index_add(0, of, by_window)
    g, h = by_block[:, 0], by_block[:, 1:]
    norm, whole = tilde.square().sum(0), c.square().sum(0)
    misfit, count = float(r.square().sum()), int((projected.row_weight > 0).sum())
    scale = math.sqrt(misfit / count)
    return Scores(
        g,
        h,
        norm,
        norm / whole.clamp_min(1e-300),
        scale,
        misfit,
        g.sum(0) / norm.clamp_min(1e-300),
        loads,
    )


def orthonormal(columns: Float[Tensor, "N P"]) -> Float[Tensor, "N Q"]:
    """An orthonormal basis of what the columns span."""
    if not columns.shape[1]:
        return columns
    U, singular, _ = torch.linalg.svd(columns / columns.norm(dim=0).clamp_min(1e-300), full_matrices=False)
    return U[:, singular > 1e-9 * singular.max()]


def p_values(
    horizons: Sequence[Scores], columns: Sequence[Column], candidates: int
) -> tuple[Float[Tensor, " K"], Float[Tensor, " K"], Int[Tensor, " K"]]:
    """z, p and the best column of each candidate; a confounded column takes no part.

    Returns:
        Per candidate: z of its best column, p of the step-down test, index of that column (-1 where it has none).
    """
    signs = flips(horizons[0].g.shape[0], horizons[0].g)
    two_sided = torch.tensor([column.two_sided for column in columns], device=signs.device)
    flipped = torch.stack([_standardised(scores, signs) for scores in horizons])  # (horizons, flips, columns)
    flipped = torch.where(two_sided, flipped.abs(), flipped)
    usable = torch.stack([scores.share >= CONFOUNDED for scores in horizons])
    by_column = torch.where(usable[:, None], flipped, -float("inf")).amax(0)  # (flips, columns)
    observed = by_column[0]  # the first flip is none at all
    z = observed.new_full((candidates,), -float("inf"))
    best = torch.full((candidates,), -1, dtype=torch.long, device=signs.device)
    for k, column in enumerate(columns):
        if observed[k] > z[column.candidate]:
            z[column.candidate], best[column.candidate] = observed[k], k
    of = torch.tensor([column.candidate for column in columns], device=signs.device).expand_as(by_column)
    by_candidate = by_column.new_full((len(signs), candidates), -float("inf")).scatter_reduce(1, of, by_column, "amax")
    return z, stepped_down(z, by_candidate), best


def stepped_down(z: Float[Tensor, " K"], flipped: Float[Tensor, "X K"]) -> Float[Tensor, " K"]:
    """p of each candidate: share of the flips whose largest z, of those that rank no higher than it, reaches its own.

    What ranks higher has shown its own misfit already; no p lies below that of a higher rank.

    Args:
        z: as the data have it.
        flipped: under each flip.
    """
    order = z.argsort(descending=True, stable=True)
    largest = flipped[:, order.flip(0)].cummax(1).values.flip(1)
    tolerance = 1e-9 * z.abs().clamp(1e-9, 1e9)
    p = (largest >= (z - tolerance)[order]).to(z).mean(0).cummax(0).values
    return torch.empty_like(p).scatter(0, order, p)


def observed(horizons: Sequence[Scores], columns: Sequence[Column]) -> Float[Tensor, " C"]:
    """z of each column as the data have it, the larger of the horizons'; -inf where it is confounded."""
    one = horizons[0].g.new_ones(1, horizons[0].g.shape[0])
    z = torch.stack([_standardised(scores, one)[0] for scores in horizons])
    two_sided = torch.tensor([column.two_sided for column in columns], device=z.device)
    usable = torch.stack([scores.share >= CONFOUNDED for scores in horizons])
    return torch.where(usable, torch.where(two_sided, z.abs(), z), -float("inf")).amax(0)


def promise(horizons: Sequence[Scores], column: int) -> float:
    """Share by which a column alone, at its least-squares size, would lower the RMS: the larger of the horizons'."""
    shares = []
    for scores in horizons:
        explained = float(scores.g[:, column].sum() ** 2 / scores.norm[column].clamp_min(1e-300))
        shares.append(1 - math.sqrt(max(0.0, 1 - explained / max(scores.misfit, 1e-300))))
    return max(shares)


def _standardised(scores: Scores, signs: Float[Tensor, "X B"]) -> Float[Tensor, "X C"]:
    total = signs @ scores.g
    mixed = torch.einsum("xb,bqc->xqc", signs, scores.h).square().sum(1)
    variance = (scores.norm - mixed).clamp_min(1e-6 * scores.norm).clamp_min(1e-300)
    return total / (max(scores.scale, 1e-300) * variance.sqrt())


def flips(blocks: int, like: Tensor) -> Float[Tensor, "X B"]:
    """All 2^B sign patterns, or as many drawn ones as are enough; the identity first."""
    if blocks <= ALL_FLIPS:
        return torch.tensor(list(itertools.product((1.0, -1.0), repeat=blocks)), dtype=like.dtype, device=like.device)
    draw = torch.Generator().manual_seed(0)
    signs = 2.0 * torch.randint(0, 2, (2**ALL_FLIPS, blocks), generator=draw) - 1.0
    signs[0] = 1.0
    return signs.to(like)
