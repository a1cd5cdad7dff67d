"""Many units of one machine: how far a number differs between them, and what the next unit's may be.

    theta_u ~ N(mu, tau^2),     y ~ N(theta, S)             y: one fitted value a unit, S: the fit's covariance of them

Contrasts z = K y do without mu (K: U - 1 orthonormal rows, K 1 = 0, turned so that K S K' is diagonal, lambda):

    log p(z | tau) = -1/2 sum_i log(lambda_i + tau^2) + z_i^2 / (lambda_i + tau^2)              (restricted likelihood)
    p(tau) prop. to  tau sqrt(sum_i (lambda_i + tau^2)^-2)                                      (its Jeffreys prior)
    mu | tau ~ N(1' C^-1 y / 1' C^-1 1, V),     C = S + tau^2 I,     V = 1 / 1' C^-1 1
    next | tau ~ N(mu, tau^2 + V),     theta | tau: mean y - S C^-1 (y - mu 1), variance of the same

What all units share (an error of a common parameter) has no part in z, so that it is not taken for likeness. The
reported spread is the largest restricted likelihood's, 0 where the units do not differ by more than their errors. The
intervals are averages over p(tau | z), for few units say little of tau. With errors far below the spread they are the
textbook's Student t with U - 1 degrees of freedom: mean ± t S sqrt(1 + 1/U) for the next unit.

Harville (1977), J. Am. Stat. Assoc. 72; the prior: Bodnar, Link, Arendacka, Possolo, Elster (2017), Stat. Med. 36.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Float
from scipy.optimize import minimize_scalar
from torch import Tensor

from onlinebayes.identification.results import Estimate

POINTS = 1500
"""Of tau, equally far apart on a logarithmic scale."""

NEAR, FAR = 1e-3, 1e4
"""The smallest tau as a share of the smallest error, and the largest as a multiple of the largest difference."""

NEGLIGIBLE = 1e-10
"""Share of the largest weight below which a point of tau is left out."""

LEVELS = (0.05, 0.95)
SDS = 1.6448536269514722
"""A normal distribution's 95 % point, in sds."""

PARTS = (0.0, *(0.1 * k for k in range(1, 9)), 0.86, 0.9, 0.93, 0.955, 0.97, 0.98, 0.99, 0.996, 1.0)
"""Parts of p(tau | z) that one normal distribution each stands for: finer where tau is large and the tail is made."""

SINGULAR = 1e-9
"""Of the mean variance: more than rounding leaves of a covariance from fewer blocks than there are units."""

HALVINGS = 60


@dataclass(frozen=True)
class Fleet:
    """One parameter over U units, in its unit; see the equations above.

    The sd of ``mean``, ``spread`` and ``next`` is that of a normal distribution with the same 90 % interval.

    Args:
        mean: mu.
        spread: tau.
        units: unit -> theta_u, drawn towards the mean by as much as its own error leaves open.
        next: the value in a unit of which nothing is measured.
        left_out: units whose value the data do not determine.
        components: (weight, mean, sd) of normal distributions whose mixture is ``next``.
    """

    mean: Estimate
    spread: Estimate
    units: Mapping[str, Estimate]
    next: Estimate
    left_out: tuple[str, ...]
    components: tuple[tuple[float, float, float], ...]


def fleet_of(
    units: Sequence[str],
    value: Float[Tensor, " U"],
    covariance: Float[Tensor, "U U"],
    unit: str = "",
    left_out: tuple[str, ...] = (),
) -> Fleet:
    """The fleet that these units are from.

    Args:
        units: names of two units or more.
        value: y [``unit``].
        covariance: S [``unit``^2].
        unit: SI unit of the parameter.
        left_out: named in the result.

    Raises:
        ValueError: fewer than two units, or a value without a positive and finite error.
    """
    y, S = value.double().cpu(), covariance.double().cpu()
    if len(y) < 2 or not bool(torch.isfinite(S).all() and (S.diagonal() > 0).all()):
        raise ValueError(f"{len(y)} units with variances {S.diagonal().tolist()}: two are needed, each with an error")
    S = S + SINGULAR * S.diagonal().mean() * torch.eye(len(y)).double()
    z, errors = _contrasts(y, S)
    tau, weight = _tau(z, errors)
    mean, variance, theta, own = _given(y, S, tau)
    spread = _restricted(z, errors, tau)
    best = _given(y, S, torch.tensor([spread], dtype=torch.float64))
    shown = [float(best[0]), *(weight @ theta).tolist()]
    means, sds = torch.cat([mean[:, None], theta], 1), torch.cat([variance[:, None], own], 1).sqrt()
    low, high = (_quantile(weight, means, sds, level) for level in LEVELS)
    known = [
        Estimate(at, (float(b) - float(a)) / (2 * SDS), float(a), float(b), unit)
        for at, a, b in zip(shown, low, high, strict=True)
    ]
    following = (tau.square() + variance).sqrt()
    ends = [float(_quantile(weight, mean[:, None], following[:, None], level)) for level in LEVELS]
    share = weight.cumsum(0)
    taus = np.exp(np.interp(LEVELS, share, tau.log())).tolist()
    return Fleet(
        known[0],
        Estimate(spread, (taus[1] - taus[0]) / (2 * SDS), min(taus[0], spread), taus[1], unit),
        dict(zip(units, known[1:], strict=True)),
        Estimate(shown[0], (ends[1] - ends[0]) / (2 * SDS), ends[0], ends[1], unit),
        left_out,
        tuple(_components(share, mean, following)),
    )


def _contrasts(y: Float[Tensor, " U"], S: Float[Tensor, "U U"]) -> tuple[Float[Tensor, " V"], Float[Tensor, " V"]]:
    """Z and lambda."""
    U = len(y)
    basis = torch.linalg.qr(torch.cat([torch.ones(U, 1).double(), torch.eye(U).double()[:, : U - 1]], 1)).Q[:, 1:].T
    errors, turned = torch.linalg.eigh(basis @ S @ basis.T)
    return turned.T @ (basis @ y), errors.clamp_min(SINGULAR * float(S.diagonal().mean()))


def _tau(z: Float[Tensor, " V"], errors: Float[Tensor, " V"]) -> tuple[Float[Tensor, " G"], Float[Tensor, " G"]]:
    """Grid of tau, and the share of p(tau | z) at each point."""
    least = NEAR * math.sqrt(float(errors.min()))
    most = FAR * math.sqrt(float(errors.max()) + float(z.square().max()))
    tau = torch.logspace(math.log10(least), math.log10(most), POINTS, dtype=torch.float64)
    total = errors + tau.square()[:, None]
    prior = tau.log() + 0.5 * total.pow(-2).sum(1).log()
    weight = torch.softmax(_log_likelihood(z, errors, tau) + prior + tau.log(), 0)  # d tau = tau d log(tau)
    kept = weight > NEGLIGIBLE * weight.max()
    return tau[kept], weight[kept] / weight[kept].sum()


def _log_likelihood(
    z: Float[Tensor, " V"], errors: Float[Tensor, " V"], tau: Float[Tensor, " G"]
) -> Float[Tensor, " G"]:
    total = errors + tau.square()[:, None]
    return -0.5 * (total.log() + z.square() / total).sum(1)


def _restricted(z: Float[Tensor, " V"], errors: Float[Tensor, " V"], tau: Float[Tensor, " G"]) -> float:
    """The tau of the largest restricted likelihood, near the best point of a grid; 0 where that is at 0."""
    k = int(_log_likelihood(z, errors, tau).argmax())
    around = tau[max(k - 1, 0)], tau[min(k + 1, len(tau) - 1)]
    found = minimize_scalar(
        lambda at: -float(_log_likelihood(z, errors, torch.tensor([at], dtype=torch.float64))),
        bounds=tuple(map(float, around)),
        method="bounded",
        options={"xatol": 1e-9 * float(around[1])},
    )
    at_zero = float(_log_likelihood(z, errors, torch.zeros(1, dtype=torch.float64)))
    return 0.0 if k == 0 or at_zero >= -float(found.fun) else float(found.x)


def _given(
    y: Float[Tensor, " U"], S: Float[Tensor, "U U"], tau: Float[Tensor, " G"]
) -> tuple[Float[Tensor, " G"], Float[Tensor, " G"], Float[Tensor, "G U"], Float[Tensor, "G U"]]:
    """mu and V, and mean and variance of theta, for every tau."""
    C = S + tau.square()[:, None, None] * torch.eye(len(y)).double()
    solved = torch.linalg.solve(C, torch.stack([torch.ones_like(y), y], -1).expand(len(tau), -1, -1))
    ones, whole = solved.unbind(-1)
    V = 1 / ones.sum(1)
    mu = whole.sum(1) * V
    pull = S @ torch.linalg.inv(C)  # of what is left towards the mean
    theta = y - (pull @ (y - mu[:, None])[..., None])[..., 0]
    variance = (S - pull @ S).diagonal(dim1=1, dim2=2) + V[:, None] * pull.sum(2).square()
    return mu, V, theta, variance.clamp_min(0)


def _quantile(
    weight: Float[Tensor, " G"], mean: Float[Tensor, "G N"], sd: Float[Tensor, "G N"], level: float
) -> Float[Tensor, " N"]:
    """Quantiles of N mixtures of normal distributions, by halving."""
    low, high = (mean - 9 * sd).amin(0), (mean + 9 * sd).amax(0)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        below = weight @ torch.special.ndtr((middle - mean) / sd.clamp_min(1e-300)) < level
        low, high = torch.where(below, middle, low), torch.where(below, high, middle)
    return (low + high) / 2


def _components(
    share: Float[Tensor, " G"], mean: Float[Tensor, " G"], sd: Float[Tensor, " G"]
) -> list[tuple[float, float, float]]:
    """The middle of each part of p(tau | z)."""
    found = []
    for a, b in pairwise(PARTS):
        k = _first(share, (a + b) / 2)
        found.append((b - a, float(mean[k]), float(sd[k])))
    return found


def _first(share: Float[Tensor, " G"], level: float) -> int:
    return int(torch.searchsorted(share, level).clamp_max(len(share) - 1))
