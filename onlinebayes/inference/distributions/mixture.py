"""Mixture of Gaussians with full covariance, truncated to a box and renormalised over it.

    q(z) = sum_k w_k N(z; mu_k, L_k L_k^T) / sum_k w_k Z_k    inside [0, 1]^P, 0 outside
    log q(theta) = log q(z) + log |dz / dtheta|

z are the coordinates of a :class:`Box` in the unit cube of the parameter space, Z_k the mass of component k in it. A
bijection from the box to all of R^P (logit, probit) would do without Z_k, but sends a truth on the edge of its bounds,
where manufacturers' defaults often stand, to infinity; truncation treats an edge like any other place.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.inference.distributions.box import Box
from onlinebayes.inference.distributions.normaliser import log_mass_in_cube
from onlinebayes.inference.distributions.sampling import choose, sample_truncated


class TruncatedMixture:
    """A batch of mixtures over theta; immutable.

    Args:
        logits: unnormalised log weights (*batch, K).
        mean: component means mu in the box's coordinates z (*batch, K, P); they may lie outside [0, 1].
        scale_tril: lower Cholesky factors L with positive diagonal (*batch, K, P, P).
        box: where the mixture lives; it is zero elsewhere.
    """

    def __init__(
        self,
        logits: Float[Tensor, "*batch K"],
        mean: Float[Tensor, "*batch K P"],
        scale_tril: Float[Tensor, "*batch K P P"],
        box: Box,
    ) -> None:
        self.log_weights = torch.log_softmax(logits, dim=-1)
        self.mean, self.scale_tril, self.box = mean, scale_tril, box
        self.space = box.space
        self._log_masses: Tensor | None = None

    @property
    def batch_shape(self) -> torch.Size:
        """Shape of the batch of mixtures; empty for a single one."""
        return self.log_weights.shape[:-1]

    def __getitem__(self, index: int) -> TruncatedMixture:
        """One mixture of the batch, or a batch of one axis less."""
        return TruncatedMixture(self.log_weights[index], self.mean[index], self.scale_tril[index], self.box)

    @property
    def log_masses(self) -> Float[Tensor, "*batch K"]:
        """log Z_k of each component."""
        if self._log_masses is None:
            self._log_masses = log_mass_in_cube(self.mean, self.scale_tril)
        return self._log_masses

    @property
    def log_normaliser(self) -> Float[Tensor, "*batch"]:
        """log sum_k w_k Z_k."""
        return torch.logsumexp(self.log_weights + self.log_masses, dim=-1)

    def log_prob(self, theta: Float[Tensor, "*shape P"]) -> Float[Tensor, "*out"]:
        """Log density on the original scale [1 / units]; ``theta`` (*sample, *batch, P) broadcasts against the batch.

        -inf outside the box; finite inside, however far out in the tails. The answer lies where theta lies.
        """
        inside = self.box.contains(theta)
        theta = torch.where(inside.unsqueeze(-1), theta, self.space.from_unit(self.box.low.to(theta)))
        density = self.log_prob_frame(self.box.to_frame(theta)).to(theta.device) + self.box.log_abs_det(theta)
        return torch.where(inside, density, -torch.inf)

    def log_prob_frame(self, z: Float[Tensor, "*shape P"]) -> Float[Tensor, "*out"]:
        """Log density in the box's coordinates, for z inside [0, 1]^P (elsewhere: the mixture's continuation)."""
        return self.log_unnormalised(z) - self.log_normaliser

    def log_unnormalised(self, z: Float[Tensor, "*shape P"]) -> Float[Tensor, "*out"]:
        """log sum_k w_k N(z; k), without the truncation."""
        z = z.to(self.mean)
        batch = self.mean.shape[:-2]
        # All draws are right-hand sides of one system a component: its factor is not copied for each of them.
        z = z.expand(*z.shape[: max(z.ndim - 1 - len(batch), 0)], *batch, z.shape[-1])
        shape = z.shape[: z.ndim - 1 - len(batch)]
        deviation = z.reshape(-1, *batch, 1, z.shape[-1]) - self.mean
        standard = torch.linalg.solve_triangular(self.scale_tril, deviation.movedim(0, -1), upper=False)
        standard = standard.movedim(-1, 0).reshape(*shape, *self.mean.shape)
        log_det = torch.log(torch.diagonal(self.scale_tril, dim1=-2, dim2=-1)).sum(-1)
        constant = 0.5 * math.log(2 * math.pi) * z.shape[-1]
        log_normal = -0.5 * standard.square().sum(-1) - log_det - constant
        return torch.logsumexp(self.log_weights + log_normal, dim=-1)

    def sample(self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None) -> Float[Tensor, "*out"]:
        """Theta (*shape, *batch, P), float64, inside the box always."""
        return self.box.from_frame(self.sample_frame(shape, generator))

    @torch.no_grad()
    def sample_frame(
        self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None
    ) -> Float[Tensor, "*out"]:
        """z (*shape, *batch, P) in [0, 1]^P."""
        log_weights = self.log_weights + self.log_masses
        count = torch.Size(shape).numel()
        K, P = self.mean.shape[-2:]
        chosen = choose(log_weights.reshape(-1, K), count, generator).T  # (count, batch)
        index = torch.arange(chosen.shape[1], device=chosen.device)
        mean = self.mean.reshape(-1, K, P)[index, chosen]
        lower = self.scale_tril.reshape(-1, K, P, P)[index, chosen]
        z = sample_truncated(mean.reshape(-1, P), lower.reshape(-1, P, P), generator)
        return z.reshape(*shape, *self.batch_shape, P)
