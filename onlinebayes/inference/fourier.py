"""Quasi-random Fourier features: a kernel's feature space, sampled by a sequence that fills it evenly.

    phi(x) = sqrt(4 / M) [cos(W x), sin(W x)],      phi(x) . phi(y) ~ 2 k(|x - y| / l),      W (M/2, E)

The rows of W follow the spectral density of the kernel (Rahimi and Recht 2007), by the sequence of Halton (Yang 2014):

    RBF           w = n / l                                          n ~ N(0, I)
    Matern nu     w = n / l sqrt(2 nu / c),   one c ~ chi^2(2 nu) a row     a multivariate t, 2 nu degrees of freedom

A chi-square of its own in every dimension would give a product of kernels, and 4 degrees of freedom are no Matern 5/2:
both are found in the published code of BayesSim, and here as ``legacy``, only to be compared. Its features have a
length scale of 5, always; :func:`~onlinebayes.inference.length_scale.cross_validate` finds one. Features have norm
sqrt(2), whatever M, so that heads on them start alike.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from scipy import stats
from torch import Tensor, nn

from onlinebayes.runs import BadInput

Kernel = Literal["rbf", "matern12", "matern32", "matern52"]

FREEDOM = {"matern12": 1, "matern32": 3, "matern52": 5}
"""2 nu."""

PUBLISHED_FREEDOM = {"matern12": 1, "matern32": 2, "matern52": 4}
"""Of the t that the published code draws in every dimension by itself."""


class FourierFeatures(nn.Module):
    """Vector (B, E) -> features (B, M); nothing of it is trained.

    Args:
        size: E.
        features: M, an even number.
        kernel: whose feature space.
        length_scale: l, in units of the standardised vector.
        seed: of the sequence's scrambling.
        legacy: draw W as the published code does, see the module; by a sequence scrambled in another way.

    Raises:
        BadInput: an odd number of features, or a length scale that is not above 0.
    """

    frequencies: Tensor

    def __init__(
        self,
        size: int,
        features: int = 500,
        *,
        kernel: Kernel = "matern52",
        length_scale: float = 5.0,
        seed: int = 0,
        legacy: bool = False,
    ) -> None:
        super().__init__()
        if features < 2 or features % 2:
            raise BadInput(f"{features} Fourier features", "needs an even number of them, 2 or more")
        if not length_scale > 0:
            raise BadInput(f"length scale {length_scale:g}", "needs a length above 0")
        draw = published_frequencies if legacy else frequencies
        drawn = draw(size, features // 2, kernel, seed) / length_scale
        self.register_buffer("frequencies", torch.from_numpy(drawn).to(torch.get_default_dtype()))

    def forward(self, vector: Float[Tensor, "*batch E"]) -> Float[Tensor, "*batch M"]:
        """The features."""
        phase = vector @ self.frequencies.T
        return math.sqrt(2 / len(self.frequencies)) * torch.cat([torch.cos(phase), torch.sin(phase)], dim=-1)


def frequencies(size: int, number: int, kernel: Kernel, seed: int) -> np.ndarray:
    """Rows of W for a length scale of 1 (number, size)."""
    heavy = kernel in FREEDOM
    # The last dimension of the sequence is the chi-square's: all of a row share it.
    points = _points(size + heavy, number, seed)
    normal = stats.norm.ppf(points[:, :size])
    if not heavy:
        return normal
    freedom = FREEDOM[kernel]
    return normal * np.sqrt(freedom / stats.chi2.ppf(points[:, -1:], freedom))


def published_frequencies(size: int, number: int, kernel: Kernel, seed: int) -> np.ndarray:
    """The same as the published code draws them: a t of its own in every dimension."""
    points = _points(size, number, seed)
    return stats.norm.ppf(points) if kernel == "rbf" else stats.t.ppf(points, PUBLISHED_FREEDOM[kernel])


def _points(size: int, number: int, seed: int) -> np.ndarray:
    points = stats.qmc.Halton(size, scramble=True, seed=seed).random(number)
    return points.clip(1e-12, 1 - 1e-12)
