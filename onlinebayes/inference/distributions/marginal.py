"""Some of a truncated mixture's parameters, the others integrated out.

    q(z_S) = sum_k w_k N(z_S; mu_S, Sigma_SS) P(z_R in [0, 1]^R | z_S, k) / sum_k w_k Z_k

The conditional of the rest R given S is a Gaussian with mean mu_R + A (z_S - mu_S), A = Sigma_RS Sigma_SS^-1, and
covariance Sigma_RR - A Sigma_SR. The marginal of a truncated Gaussian is not itself a truncated Gaussian: leaving the
last factor out would be wrong next to the edges.
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
from onlinebayes.inference.distributions.uniform import BoxUniform


class Marginal:
    """The joint distribution of the parameters ``names``.

    Args:
        distribution: over all parameters; a single one, no batch.
        names: which to keep, in this order.
    """

    def __init__(self, distribution: TruncatedMixture | BoxUniform, names: Sequence[str]) -> None:
        self._joint = distribution
        self._keep = [distribution.space.index(name) for name in names]
        self._rest = [i for i in range(len(distribution.space)) if i not in self._keep]
        box = distribution.box
        self.space = box.space.subspace(names)
        self.box = Box(self.space, box.low[self._keep], box.high[self._keep])

    def sample(
        self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None
    ) -> Float[Tensor, "*shape S"]:
        """Values of the kept parameters (*shape, S) in SI units."""
        return self._joint.sample(shape, generator)[..., self._keep]

    def log_prob(self, theta: Float[Tensor, "*batch S"]) -> Float[Tensor, "*batch"]:
        """Log density on the original scale [1 / units]; -inf outside the box."""
        if isinstance(self._joint, BoxUniform):
            return BoxUniform(self.space, self.box).log_prob(theta)
        inside = self.box.contains(theta)
        theta = torch.where(inside.unsqueeze(-1), theta, self.space.from_unit(self.box.low.to(theta)))
        density = self._log_prob_frame(self._joint, self.box.to_frame(theta)).to(theta.device)
        return torch.where(inside, density + self.box.log_abs_det(theta), -torch.inf)

    def _log_prob_frame(self, mixture: TruncatedMixture, z: Tensor) -> Tensor:
        S, R = self._keep, self._rest
        covariance = mixture.scale_tril @ mixture.scale_tril.mT
        lower = torch.linalg.cholesky(covariance[:, S][:, :, S])
        deviation = (z.to(mixture.mean).unsqueeze(-2) - mixture.mean[:, S]).unsqueeze(-1)
        standard = torch.linalg.solve_triangular(
            lower.expand(*deviation.shape[:-1], len(S)), deviation, upper=False
        ).squeeze(-1)
        log_det = torch.log(torch.diagonal(lower, dim1=-2, dim2=-1)).sum(-1)
        log_normal = -0.5 * standard.square().sum(-1) - log_det - 0.5 * math.log(2 * math.pi) * len(S)
        if R:
            # A = Sigma_RS Sigma_SS^-1, through the Cholesky factor: whitened = L^-1 Sigma_SR.
            whitened = torch.linalg.solve_triangular(lower, covariance[:, S][:, :, R], upper=False)
            mean = mixture.mean[:, R] + (whitened.mT @ standard.unsqueeze(-1)).squeeze(-1)
            rest = torch.linalg.cholesky(covariance[:, R][:, :, R] - whitened.mT @ whitened)
            log_normal = log_normal + log_mass_in_cube(mean, rest.expand(*mean.shape, len(R)))
        return torch.logsumexp(mixture.log_weights + log_normal, dim=-1) - mixture.log_normaliser
