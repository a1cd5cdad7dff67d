"""Mixtures made of mixtures: seen in another box, widened, united, multiplied.

    union      q(z) = 1/n sum_i q_i(z)                      at least one of n posteriors holds
    product    q(z) prop. to prod_i q_i(z)                  the posterior given n independent trajectories
                                                            under a uniform prior (of which n - 1 are divided out)

Both stay mixtures of Gaussians truncated to a box. N(m1, S1) N(m2, S2) = N(m1; m2, S1 + S2) N(m, S) with
S^-1 = S1^-1 + S2^-1 and m = S (S1^-1 m1 + S2^-1 m2); the product of n mixtures has K^n components, of which only the
heaviest are kept.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch

from onlinebayes.inference.distributions.box import Box
from onlinebayes.inference.distributions.mixture import TruncatedMixture


def in_box(mixture: TruncatedMixture, box: Box) -> TruncatedMixture:
    """The same Gaussians, truncated to ``box`` instead of to the mixture's own, in double precision."""
    old = mixture.box
    width = (old.high - old.low).to(mixture.mean.device)
    new_low, new_width = box.low.to(width), (box.high - box.low).to(width)
    mean = (old.low.to(width) + mixture.mean.double() * width - new_low) / new_width
    scale_tril = mixture.scale_tril.double() * (width / new_width).unsqueeze(-1)
    return TruncatedMixture(mixture.log_weights.double(), mean, scale_tril, box)


def widened(mixture: TruncatedMixture, factor: float) -> TruncatedMixture:
    """The mixture with every component's scales times ``factor``."""
    return TruncatedMixture(mixture.log_weights, mixture.mean, factor * mixture.scale_tril, mixture.box)


def union(mixtures: Sequence[TruncatedMixture]) -> TruncatedMixture:
    """1/n sum of n mixtures over one box."""
    box = _shared_box(mixtures)
    # Each is normalised over the box first: otherwise one that leans over the edge would count less.
    logits = [m.log_weights - m.log_normaliser.unsqueeze(-1) for m in mixtures]
    return TruncatedMixture(
        torch.cat(logits, -1),
        torch.cat([m.mean for m in mixtures], -2),
        torch.cat([m.scale_tril for m in mixtures], -3),
        box,
    )


def product(mixtures: Sequence[TruncatedMixture], *, keep: int = 64) -> TruncatedMixture:
    """The normalised product of mixtures over one box; after each factor the ``keep`` heaviest components stay."""
    box = _shared_box(mixtures)
    result = in_box(mixtures[0], box)
    for factor in mixtures[1:]:
        result = _pairwise(result, in_box(factor, box), keep)
    return result


def _pairwise(first: TruncatedMixture, second: TruncatedMixture, keep: int) -> TruncatedMixture:
    lower1, lower2 = first.scale_tril.unsqueeze(-3), second.scale_tril.unsqueeze(-4)
    mean1, mean2 = first.mean.unsqueeze(-2), second.mean.unsqueeze(-3)
    precision1, precision2 = torch.cholesky_inverse(lower1), torch.cholesky_inverse(lower2)
    covariance = torch.cholesky_inverse(torch.linalg.cholesky(precision1 + precision2))
    gap = (mean2 - mean1).unsqueeze(-1)
    # Written from the first mean: the difference of two large numbers is not formed.
    mean = mean1 + (covariance @ (precision2 @ gap)).squeeze(-1)
    spread = torch.linalg.cholesky(lower1 @ lower1.mT + lower2 @ lower2.mT)
    standard = torch.linalg.solve_triangular(spread, gap, upper=False).squeeze(-1)
    log_overlap = -0.5 * standard.square().sum(-1) - torch.log(torch.diagonal(spread, dim1=-2, dim2=-1)).sum(-1)
    logits = first.log_weights.unsqueeze(-1) + second.log_weights.unsqueeze(-2) + log_overlap
    logits, mean, covariance = logits.flatten(-2), mean.flatten(-3, -2), covariance.flatten(-4, -3)
    if logits.shape[-1] > keep:
        logits, index = logits.topk(keep, dim=-1)
        mean = mean.gather(-2, index.unsqueeze(-1).expand(*index.shape, mean.shape[-1]))
        covariance = covariance.gather(
            -3, index.unsqueeze(-1).unsqueeze(-1).expand(*index.shape, *covariance.shape[-2:])
        )
    return TruncatedMixture(logits, mean, torch.linalg.cholesky(covariance), first.box)


def _shared_box(mixtures: Sequence[TruncatedMixture]) -> Box:
    if not mixtures:
        raise ValueError("no mixture given; give at least one")
    box = mixtures[0].box
    for mixture in mixtures[1:]:
        same = torch.equal(mixture.box.low, box.low) and torch.equal(mixture.box.high, box.high)
        if mixture.space != box.space or not same:
            raise ValueError("the mixtures live in different boxes; bring them into one with in_box first")
    return box


def doubled(mixture: TruncatedMixture) -> TruncatedMixture:
    """The mixture in double precision."""
    return TruncatedMixture(
        mixture.log_weights.double(), mixture.mean.double(), mixture.scale_tril.double(), mixture.box
    )
