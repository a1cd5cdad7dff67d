"""Mixtures made of mixtures: seen in another box, widened, united, multiplied.

    union      q(z) = 1/n sum_i q_i(z)                      at least one of n posteriors holds
    product    q(z) prop. to prod_i q_i(z)                  the posterior given n independent trajectories
                                                            under a uniform prior (of which n - 1 are divided out)

    overlap    log of the integral of q_1(z) q_2(z)         how much likelier both are with one theta than with two
    stepped    z + N(0, s^2), z ~ q                         theta after a small change of unknown direction

All but the overlap stay mixtures of Gaussians truncated to a box. N(m1, S1) N(m2, S2) = N(m1; m2, S1 + S2) N(m, S) with
S^-1 = S1^-1 + S2^-1 and m = S (S1^-1 m1 + S2^-1 m2); the product of n mixtures has K^n components, of which only the
heaviest are kept. Of data A and B, under a prior that is uniform on the box,

    p(A, B | one theta) / (p(A) p(B)) = integral of q(theta | A) q(theta | B) / p(theta)

is the overlap of their posteriors: what the product has to be divided by.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.inference.distributions.box import Box
from onlinebayes.inference.distributions.mixture import TruncatedMixture
from onlinebayes.inference.distributions.normaliser import log_mass_in_cube


def in_box(mixture: TruncatedMixture, box: Box) -> TruncatedMixture:
    """The same Gaussians, truncated to ``box`` instead of to the mixture's own, in double precision."""
    old = mixture.box
    if torch.equal(box.low, old.low) and torch.equal(box.high, old.high):
        return doubled(mixture)
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
    return weighed(mixtures, [0.0] * len(mixtures))


def weighed(mixtures: Sequence[TruncatedMixture], log_weights: Sequence[float]) -> TruncatedMixture:
    """sum_i w_i q_i, the weights up to a common factor."""
    box = _shared_box(mixtures)
    # Each is normalised over the box first: otherwise one that leans over the edge would count less.
    logits = [w + m.log_weights - m.log_normaliser.unsqueeze(-1) for w, m in zip(log_weights, mixtures, strict=True)]
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


def log_overlap(first: TruncatedMixture, second: TruncatedMixture) -> Float[Tensor, "*batch"]:
    """Log of the integral of two densities' product over their box, in the box's coordinates; see the module."""
    _shared_box([first, second])
    logits, mean, lower = _pairs(doubled(first), doubled(second))
    log_mass = logits + log_mass_in_cube(mean, lower) - 0.5 * math.log(2 * math.pi) * mean.shape[-1]
    return torch.logsumexp(log_mass, -1) - first.log_normaliser - second.log_normaliser


def stepped(mixture: TruncatedMixture, sd: float) -> TruncatedMixture:
    """Theta after a step N(0, sd^2) [widths of the unit cube] from where the mixture has it, given that it stays there.

    The result lies in the whole cube, wherever the mixture does.
    """
    mixture = in_box(mixture, Box.whole(mixture.space))
    covariance = mixture.scale_tril @ mixture.scale_tril.mT
    wider = covariance + sd**2 * torch.eye(covariance.shape[-1]).to(covariance)
    return TruncatedMixture(mixture.log_weights, mixture.mean, torch.linalg.cholesky(wider), mixture.box)


def heaviest(mixture: TruncatedMixture, keep: int) -> TruncatedMixture:
    """The mixture without its lightest components, where it has more than ``keep``."""
    if mixture.log_weights.shape[-1] <= keep:
        return mixture
    logits, index = mixture.log_weights.topk(keep, dim=-1)
    mean, lower = mixture.mean, mixture.scale_tril
    mean = mean.gather(-2, index.unsqueeze(-1).expand(*index.shape, mean.shape[-1]))
    lower = lower.gather(-3, index.unsqueeze(-1).unsqueeze(-1).expand(*index.shape, *lower.shape[-2:]))
    return TruncatedMixture(logits, mean, lower, mixture.box)


def _pairwise(first: TruncatedMixture, second: TruncatedMixture, keep: int) -> TruncatedMixture:
    return heaviest(TruncatedMixture(*_pairs(first, second), first.box), keep)


def _pairs(
    first: TruncatedMixture, second: TruncatedMixture
) -> tuple[Float[Tensor, "*batch K"], Float[Tensor, "*batch K P"], Float[Tensor, "*batch K P P"]]:
    """Log weights (without the factors of 2 pi), means and scales of the products of all pairs of components."""
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
    return logits.flatten(-2), mean.flatten(-3, -2), torch.linalg.cholesky(covariance).flatten(-4, -3)


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
    """The mixture in double precision; itself where it is, for it knows its masses."""
    if mixture.mean.dtype == mixture.log_weights.dtype == mixture.scale_tril.dtype == torch.float64:
        return mixture
    return TruncatedMixture(
        mixture.log_weights.double(), mixture.mean.double(), mixture.scale_tril.double(), mixture.box
    )
