"""Weighted draws in a box, smoothed into a mixture of Gaussians that is truncated to it.

    q(z) = sum_i w_i N(z; a z_i + (1 - a) m, h^2 C) / Z_i,    a^2 = 1 - h^2,    h = (4 / (N (P + 2)))^(1 / (P + 4))

m and C are the draws' weighted mean and covariance, N = 1 / sum w_i^2 the number of equal draws that they are worth, h
Silverman's rule (1986). Moved towards their mean, the kernels keep the draws' covariance (West 1993). Z_i is a kernel's
mass in the box: each counts by its weight, also beside an edge.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.inference.distributions.box import Box
from onlinebayes.inference.distributions.mixture import TruncatedMixture
from onlinebayes.inference.distributions.normaliser import log_mass_in_cube

THINNEST = 1e-9
"""Of the box's width: a kernel's least standard deviation, so that draws on a line have one, too."""


def smoothed(z: Float[Tensor, "N P"], weight: Float[Tensor, " N"], box: Box) -> TruncatedMixture:
    """A kernel at each draw.

    Args:
        z: draws in the box's coordinates.
        weight: w, positive, of sum 1.
        box: where they lie.
    """
    size = z.shape[1]
    mean, covariance = moments(z, weight)
    effective = 1 / float(weight.square().sum())
    h = min((4 / (effective * (size + 2))) ** (1 / (size + 4)), 1.0)
    lower = torch.linalg.cholesky(h**2 * covariance + THINNEST**2 * torch.eye(size).to(z))
    lower = lower.expand(len(z), size, size)
    centre = mean + math.sqrt(1 - h**2) * (z - mean)
    return TruncatedMixture(weight.log() - log_mass_in_cube(centre, lower), centre, lower, box)


def moments(z: Float[Tensor, "N P"], weight: Float[Tensor, " N"]) -> tuple[Float[Tensor, " P"], Float[Tensor, "P P"]]:
    """Weighted mean and covariance of draws."""
    mean = weight @ z
    centred = z - mean
    return mean, (centred * weight[:, None]).T @ centred
