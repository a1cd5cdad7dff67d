"""From the density learnt under a Gaussian proposal to the posterior under the prior.

    q(theta | x)  prop. to  p~(theta) L(x | theta)    what a network learns on theta ~ p~
    p(theta | x)  prop. to  q(theta | x) p(theta) / p~(theta)

With q a mixture of Gaussians (weights a_k, means mu_k, covariances S_k), p~ one Gaussian N(mu_0, S_0) and p uniform,
all on one box, the quotient is a mixture again (Papamakarios and Murray 2016, appendix; thesis Eq 4.14-4.19). The box
cuts numerator and denominator alike, so that the quotient is exact on it, edges included. With S_k = L_k L_k^T and
S_0 = L_0 L_0^T nothing is inverted; V, d and the eigenvalues r belong to one component k:

| equation                                                          | code                                            |
|-------------------------------------------------------------------|-------------------------------------------------|
|                                                                   | V = L_0^-1 L_k,  V^T V = Q diag(r) Q^T          |
|                                                                   | d = L_0^-1 (mu_k - mu_0),  f = Q^T V^T d        |
| 4.16  S'_k = (S_k^-1 - S_0^-1)^-1                                 | root root^T,  root = L_k Q diag(1 - r)^(-1/2)   |
| 4.17  mu'_k = S'_k (S_k^-1 mu_k - S_0^-1 mu_0)                    | mu_k + L_k Q (f / (1 - r))                      |
| 4.18, 4.19  log a'_k = log a_k - lambda_k / 2 + constant          | log a_k + (sum f^2 / (1 - r) - log(1 - r)       |
|                                                                   | + d^T d) / 2                                    |

The thesis prints S_k^-1 as the outer factor of Eq 4.17; it has to be S'_k. S'_k is a covariance only where all r < 1:
r is the variance of the component, as a share of the proposal's, along one of P directions. Theory has r < 1, since
data only narrow; a network's error has not. What is then left on the box is no mixture of Gaussians.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from onlinebayes.inference.distributions import Box, TruncatedMixture
from onlinebayes.inference.distributions.algebra import doubled, in_box
from onlinebayes.inference.proposals import Region

WIDEST = 1 - 1e-6
"""Largest r that counts as narrower than the proposal: a network's widths are in single precision."""


@dataclass(frozen=True, eq=False)
class Uncorrectable:
    """The posterior under the prior is no mixture of Gaussians.

    Attributes:
        component: index (*batch, k) of the widest component; None where the proposal is itself a mixture.
        ratio: largest r of that component, its variance over the proposal's in one direction; 1 or more.
        reason: one line.
    """

    component: tuple[int, ...] | None
    ratio: float | None
    reason: str


def corrected(density: TruncatedMixture, proposal: Region | TruncatedMixture) -> TruncatedMixture | Uncorrectable:
    """The posterior under a prior that is uniform on the density's box, in float64.

    Args:
        density: q, one or a batch of them, learnt on theta drawn from the proposal.
        proposal: p~, a single mixture of one component, whose box holds the density's; or a region with the prior's
            density inside it (``BoxUniform``, ``TruncatedProposal``), which needs no correction.

    Returns:
        The corrected mixture in the same box; or why it does not exist. A batch is refused where one of it is.

    Raises:
        ValueError: a batch of proposals, or a box outside the proposal's.
    """
    if not isinstance(proposal, TruncatedMixture):
        return doubled(density)
    if proposal.batch_shape or not _holds(proposal.box, density.box):
        raise ValueError(
            f"a proposal of batch shape {tuple(proposal.batch_shape)} with another box;"
            " needs a single one whose box holds the density's"
        )
    if len(proposal.log_weights) > 1:
        found = f"the proposal has {len(proposal.log_weights)} components, and a quotient of mixtures is none"
        return Uncorrectable(None, None, found)
    return _divided(doubled(density), in_box(proposal, density.box))


def _divided(density: TruncatedMixture, proposal: TruncatedMixture) -> TruncatedMixture | Uncorrectable:
    lower0, mean0 = proposal.scale_tril.to(density.mean.device), proposal.mean.to(density.mean.device)
    lower, mean = density.scale_tril, density.mean
    V = torch.linalg.solve_triangular(lower0.expand_as(lower), lower, upper=False)
    r, Q = torch.linalg.eigh(V.mT @ V)
    widest = r.amax(-1)
    if not bool((widest <= WIDEST).all()):
        return _uncorrectable(widest)
    left = 1 - r
    d = torch.linalg.solve_triangular(lower0.expand_as(lower), (mean - mean0).unsqueeze(-1), upper=False)
    f = (Q.mT @ V.mT @ d).squeeze(-1)
    shift = (lower @ Q @ (f / left).unsqueeze(-1)).squeeze(-1)
    log_quotient = 0.5 * ((f.square() / left - torch.log(left)).sum(-1) + d.square().sum((-2, -1)))
    root = lower @ Q * left.rsqrt().unsqueeze(-2)
    return TruncatedMixture(density.log_weights + log_quotient, mean + shift, _triangular(root), density.box)


def _uncorrectable(widest: Tensor) -> Uncorrectable:
    index = torch.unravel_index(widest.argmax(), widest.shape)
    component, ratio = tuple(int(i) for i in index), float(widest.max())
    return Uncorrectable(component, ratio, f"component {component[-1]} has {ratio:.3g} times the proposal's variance")


def _triangular(root: Tensor) -> Tensor:
    """Lower triangular L with a positive diagonal and L L^T = root root^T, without forming the product."""
    upper = torch.linalg.qr(root.mT, mode="r").R
    sign = torch.diagonal(upper, dim1=-2, dim2=-1).sign()
    return (sign.unsqueeze(-1) * upper).mT


def _holds(outer: Box, inner: Box) -> bool:
    low, high = outer.low.to(inner.low), outer.high.to(inner.high)
    return bool(((low <= inner.low) & (inner.high <= high)).all())
