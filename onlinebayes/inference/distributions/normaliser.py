"""Log probability of the unit cube under a Gaussian with full covariance.

    Z(mu, L) = integral over [0, 1]^P of N(z; mu, L L^T) dz

P = 1 is a difference of two error functions. For P = 2 one variable is integrated exactly and the other by
Gauss-Legendre quadrature, over the part of its interval that holds the mass (the integrand is log-concave, so that
part is an interval). For P > 2 separation of variables (Genz 1992) writes Z as a mean over
the unit cube of P - 1 dimensions, taken over a fixed Sobol sequence: deterministic, and smooth in mu and L. The
mass between the two sides of one axis is an upper bound for a fraction of the work.

Everything is done with logarithms: a Gaussian that hardly touches the cube has a small log Z, not NaN.
"""

from __future__ import annotations

import functools
import math

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.inference.distributions.normal import between, log_interval

NODES = 24  # of the quadrature: relative error below 1e-6 for ordinary, 1e-3 for needle-like Gaussians
POINTS = 128  # of the Sobol sequence
DROP = 30.0  # log of the peak over what is left out of the integral
INSIDE = 6.0  # standard deviations from every side at which a Gaussian counts as inside: 2e-9 a side is left out


def log_mass_in_cube(
    mean: Float[Tensor, "*batch P"], scale_tril: Float[Tensor, "*batch P P"]
) -> Float[Tensor, "*batch"]:
    """log Z of N(mean, L L^T) with L = ``scale_tril``; differentiable in both."""
    if mean.shape[-1] == 0:
        return mean.new_zeros(mean.shape[:-1])
    with torch.no_grad():
        reach = INSIDE * scale_tril.norm(dim=-1)
        leaking = ((mean < reach) | (mean > 1 - reach)).any(-1)
    # A component that lies inside has Z = 1: in a late round that is nearly all of them, and nothing is integrated.
    values = _log_mass(mean[leaking], scale_tril[leaking])
    return torch.zeros_like(mean[..., 0]).masked_scatter(leaking, values)


def log_mass_bound(mean: Float[Tensor, "*batch P"], scale_tril: Float[Tensor, "*batch P P"]) -> Float[Tensor, "*batch"]:
    """An upper bound of log Z: the least mass between the two sides of one axis, min_j log Z(mu_j, s_j^2).

    Exact for P = 1, and where the Gaussian leaves the cube along one axis only. A bound, whatever the correlations are:
    the product over the axes is none, and a network that learns by it finds Gaussians that it overrates.
    """
    scale = scale_tril.norm(dim=-1)
    return log_interval(-mean / scale, (1 - mean) / scale).amin(-1)


def _log_mass(mean: Tensor, scale_tril: Tensor) -> Tensor:
    size = mean.shape[-1]
    if size == 1:
        scale = scale_tril[..., 0, 0]
        return log_interval(-mean[..., 0] / scale, (1 - mean[..., 0]) / scale)
    if size == 2:
        return _two(mean, scale_tril)
    return _many(mean, scale_tril)


def _two(mean: Tensor, scale_tril: Tensor) -> Tensor:
    l11, l21, l22 = (scale_tril[..., i, j].unsqueeze(-1) for i, j in ((0, 0), (1, 0), (1, 1)))
    m1, m2 = mean[..., :1], mean[..., 1:]
    a, b = -m1 / l11, (1 - m1) / l11

    def log_integrand(z: Tensor) -> Tensor:
        inner = log_interval((-m2 - l21 * z) / l22, (1 - m2 - l21 * z) / l22)
        return inner - 0.5 * z.square() - 0.5 * math.log(2 * math.pi)

    with torch.no_grad():
        low, high = ((end - a) / (b - a) for end in _where_the_mass_is(m2, l21, l22, a, b))
        # What rounding leaves of a needle's tail still has a width.
        least = 100 * torch.finfo(mean.dtype).eps
        low = low.clamp(0, 1 - least)
        high = torch.maximum(high.clamp(max=1), low + least)
    nodes, log_weights = _gauss_legendre(NODES, mean.dtype, mean.device)
    # The limits follow a and b with their gradients; where they are inner points the integrand is nothing.
    fraction = low + (high - low) * nodes
    log_f = log_integrand(a + (b - a) * fraction)
    return torch.logsumexp(log_f + log_weights + torch.log((b - a) * (high - low)), dim=-1)


def _where_the_mass_is(m2: Tensor, l21: Tensor, l22: Tensor, a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """Ends within [a, b] (..., 1) outside of which the integrand lies DROP or more below its peak.

    Up to a slowly varying factor it is exp(-r^2 / 2), r^2 = z^2 + d^2, where d is how far the second variable's
    interval lies from its centre: d = max(0, p + s z, -q - s z) with s = -l21 / l22. The set r^2 <= limit of each of
    the two straight lines is an interval in closed form, and so is the place of the peak.
    """
    slope, p, q = -l21 / l22, -m2 / l22, (1 - m2) / l22
    bend = 1 + slope.square()
    # Both lines are never above zero at once (q > p): the nearest place is that of the one that is, at z = 0.
    nearest = torch.where(p > 0, -p * slope / bend, torch.where(q < 0, -q * slope / bend, 0.0))
    peak = torch.minimum(torch.maximum(nearest, a), b)
    d = torch.maximum(p + slope * peak, -q - slope * peak).clamp(min=0)
    limit = peak.square() + d.square() + 2 * DROP
    low, high = a, b
    for offset, sign in ((p, 1.0), (-q, -1.0)):
        # z^2 + (offset + sign slope z)^2 <= limit where the line is above zero, |z| <= sqrt(limit) where it is not.
        steep = sign * slope
        root = ((bend * limit - offset.square()).clamp(min=0)).sqrt()
        outer = limit.sqrt()
        left, right = (-offset * steep - root) / bend, (-offset * steep + root) / bend
        low = torch.maximum(low, torch.where(offset + steep * left > 0, left, -outer))
        high = torch.minimum(high, torch.where(offset + steep * right > 0, right, outer))
    return torch.minimum(low, peak), torch.maximum(high, peak)


def _many(mean: Tensor, scale_tril: Tensor) -> Tensor:
    size = mean.shape[-1]
    w = _sobol(size - 1, POINTS, mean.dtype, mean.device)
    mean, scale_tril = mean.unsqueeze(-2), scale_tril.unsqueeze(-3)
    z: list[Tensor] = []
    total = mean.new_zeros(())
    for j in range(size):
        shift = sum((scale_tril[..., j, i] * z[i] for i in range(j)), mean[..., j])
        a, b = torch.broadcast_tensors(-shift / scale_tril[..., j, j], (1 - shift) / scale_tril[..., j, j])
        total = total + log_interval(a, b)
        if j < size - 1:
            shape = torch.broadcast_shapes(a.shape, w[:, j].shape)
            z.append(between(a.expand(shape), b.expand(shape), w[:, j].expand(shape)))
    return torch.logsumexp(total, dim=-1) - math.log(POINTS)


@functools.lru_cache(maxsize=16)
def _gauss_legendre(count: int, dtype: torch.dtype, device: torch.device) -> tuple[Tensor, Tensor]:
    """Nodes and log weights on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (
        torch.as_tensor((nodes + 1) / 2, dtype=dtype, device=device),
        torch.as_tensor(np.log(weights / 2), dtype=dtype, device=device),
    )


@functools.lru_cache(maxsize=16)
def _sobol(size: int, count: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    engine = torch.quasirandom.SobolEngine(size, scramble=True, seed=1)
    return engine.draw(count, dtype=torch.float64).clamp(1e-6, 1 - 1e-6).to(dtype=dtype, device=device)
