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
from onlinebayes.inference.distributions.normaliser import log_mass_bound, log_mass_in_cube
from onlinebayes.inference.distributions.sampling import choose, sample_truncated, sample_whole

WHOLE = 0.1
"""Share of a mixture in its box from which on it is drawn as a whole, and what falls outside is thrown away."""

PIECE = 262_144
"""Numbers that are worked on at once on a processor: a million points pass through its cache, not through memory."""


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
        if not len(self.space):
            return theta.new_zeros(theta.shape[:-1])
        own = len(self.batch_shape)
        shape = theta.shape[: max(theta.ndim - 1 - own, 0)]
        rows = theta.reshape(-1, *theta.shape[len(shape) :])
        values = torch.cat([self._log_prob(piece) for piece in rows.split(self._at_once)])
        return values.reshape((*shape, *values.shape[1:]))

    def _log_prob(self, theta: Float[Tensor, "*shape P"]) -> Float[Tensor, "*out"]:
        # Column by column in memory: what is done alike to all points of a column runs several times as fast.
        theta = theta.movedim(-1, 0).contiguous().movedim(0, -1)
        z = self.box.to_frame(theta)
        inside = self.box.holds(z)
        if not bool(inside.all()):
            theta = torch.where(inside.unsqueeze(-1), theta, self.space.from_unit(self.box.low.to(theta)))
            z = self.box.to_frame(theta)
        density = self.log_prob_frame(z).to(theta.device) + self.box.log_abs_det(theta)
        return torch.where(inside, density, -torch.inf)

    @property
    def _at_once(self) -> int:
        """Points a mixture of the batch that are worked on together."""
        numbers = PIECE if self.mean.device.type == "cpu" else 1000 * PIECE
        return max(1, numbers // max(1, self.log_weights.numel()))

    def log_prob_frame(self, z: Float[Tensor, "*shape P"]) -> Float[Tensor, "*out"]:
        """Log density in the box's coordinates, for z inside [0, 1]^P (elsewhere: the mixture's continuation)."""
        return self.log_unnormalised(z) - self.log_normaliser

    def log_prob_bound(self, z: Float[Tensor, "*shape P"]) -> Float[Tensor, "*out"]:
        """A lower bound of :meth:`log_prob_frame` for a fifth of the work: masses by their upper bounds."""
        masses = log_mass_bound(self.mean, self.scale_tril)
        return self.log_unnormalised(z) - torch.logsumexp(self.log_weights + masses, dim=-1)

    def log_unnormalised(self, z: Float[Tensor, "*shape P"]) -> Float[Tensor, "*out"]:
        """log sum_k w_k N(z; k), without the truncation."""
        z = z.to(self.mean)
        batch = self.mean.shape[:-2]
        z = z.expand(*z.shape[: max(z.ndim - 1 - len(batch), 0)], *batch, z.shape[-1])
        shape = z.shape[: z.ndim - 1 - len(batch)]
        log_det = torch.log(torch.diagonal(self.scale_tril, dim1=-2, dim2=-1)).sum(-1)
        peak = self.log_weights - log_det - 0.5 * math.log(2 * math.pi) * z.shape[-1]
        distance = self._square_distance(z.reshape(-1, *batch, z.shape[-1]))
        log_normal = torch.add(peak.movedim(-1, 0).unsqueeze(1), distance, alpha=-0.5)
        return torch.logsumexp(log_normal, dim=0).reshape((*shape, *batch))

    def _square_distance(self, z: Float[Tensor, "S *batch P"]) -> Float[Tensor, "K S *batch"]:
        """|L_k^-1 (z - mu_k)|^2 by forward substitution, written out: a solver's calls cost more than P^2 products."""
        mean = self.mean.movedim(-2, 0).unsqueeze(1).unbind(-1)
        lower = [row.unbind(-1) for row in self.scale_tril.movedim(-3, 0).unsqueeze(1).unbind(-2)]
        standard: list[Tensor] = []
        distance = self.mean.new_zeros(())
        for i, column in enumerate(z.unsqueeze(0).unbind(-1)):
            rest = column - mean[i]
            for factor, known in zip(lower[i], standard, strict=False):
                rest = torch.addcmul(rest, factor, known, value=-1)
            standard.append(rest * lower[i][i].reciprocal())
            distance = torch.addcmul(distance, standard[i], standard[i])
        return distance

    def sample(self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None) -> Float[Tensor, "*out"]:
        """Theta (*shape, *batch, P), float64, inside the box always."""
        if not len(self.space):  # nothing is free: there is nothing to draw
            return self.mean.new_zeros(*shape, *self.batch_shape, 0, dtype=torch.float64)
        theta = self.sample_frame((torch.Size(shape).numel(),), generator).double()
        for piece in theta.split(self._at_once):  # in place: fresh memory takes longer than the numbers
            piece.copy_(self.box.from_frame(piece))
        return theta.reshape(*shape, *theta.shape[1:])

    @torch.no_grad()
    def sample_frame(
        self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None
    ) -> Float[Tensor, "*out"]:
        """z (*shape, *batch, P) in [0, 1]^P."""
        count = torch.Size(shape).numel()
        K, P = self.mean.shape[-2:]
        if not self.batch_shape:
            return self._sample(count, generator).reshape(*shape, P)
        log_weights = self.log_weights + self.log_masses
        chosen = choose(log_weights.reshape(-1, K), count, generator).T  # (count, batch)
        index = torch.arange(chosen.shape[1], device=chosen.device)
        mean = self.mean.reshape(-1, K, P)[index, chosen]
        lower = self.scale_tril.reshape(-1, K, P, P)[index, chosen]
        z = sample_truncated(mean.reshape(-1, P), lower.reshape(-1, P, P), generator)
        return z.reshape(*shape, *self.batch_shape, P)

    @torch.no_grad()
    def _sample(self, count: int, generator: torch.Generator | None) -> Float[Tensor, "N P"]:
        """z of draws of a single mixture."""
        share = float(self.log_normaliser.exp())
        if share > WHOLE:
            weights = self.log_weights.exp()
            return sample_whole(weights, self.mean, self.scale_tril, share, count, self._at_once, generator)
        chosen = choose((self.log_weights + self.log_masses)[None], count, generator)[0]
        return sample_truncated(self.mean[chosen], self.scale_tril[chosen], generator)
