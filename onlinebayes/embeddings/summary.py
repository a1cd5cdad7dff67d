"""Trajectory -> vector: averages over its steps, and the parameters that fit it best to first order.

    m = mean_t f_t                                     the statistics of BayesSim's kind (Eq 4.20 of the thesis)
    delta = (mean_t H_t + l I)^-1 mean_t s_t           one Gauss-Newton step from the reference's parameters
    e = 3 asinh((x - mean) / 3 sd),    x = [m, delta]    (straight within 3 sd, logarithmic in the tails)

delta is a score compressed to one number a parameter (Alsing and Wandelt 2018): where the model is linear in the
parameters near the reference, nothing is lost in it. It need not be right; the estimator learns from simulations what
it means, its bias under sensor noise included. Nothing here is trained, so it costs no time in training.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.embeddings.base import StepwiseEmbedding, check_padding, cleared
from onlinebayes.embeddings.features import TransitionFeatures
from onlinebayes.embeddings.standard import Standard

RIDGE = 1e-6
"""l, in units of the mean diagonal of H."""


class SummaryEmbedding(StepwiseEmbedding):
    """Standardised averages of a trajectory, and its least-squares step where the features have sensitivities.

    Args:
        features: what is told about each transition.
        averages: give m; without it only delta, which needs sensitivities.

    Raises:
        ValueError: neither averages nor sensitivities.
    """

    features: TransitionFeatures

    def __init__(self, features: TransitionFeatures, *, averages: bool = True) -> None:
        super().__init__(features)
        if not averages and not features.sensitivities:
            raise ValueError("nothing to summarise: give averages=True or features with sensitivities")
        self.averages = averages
        self.size = (features.signals if averages else 0) + features.sensitivities
        self.state_size = features.signals + features.sums + 1
        self.standard = Standard(self.size)

    def scale(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> None:
        """Mean and standard deviation of x over trajectories."""
        self.standard.fit(self._summary(self._mean(features, mask)))

    def encode(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> Float[Tensor, "B E"]:
        """Embed features made before; see :meth:`Embedding.encode`."""
        check_padding(mask)
        vector = self.standard(self._summary(self._mean(features, mask))).to(features.dtype)
        return torch.where(mask.any(1, keepdim=True), vector, torch.zeros_like(vector))

    def step(
        self, features: Float[Tensor, "B F"], state: Float[Tensor, "B S"]
    ) -> tuple[Float[Tensor, "B E"], Float[Tensor, "B S"]]:
        """One more transition; see :meth:`StepwiseEmbedding.step`."""
        total = state[..., :-1] + features[..., self.features.signals :].to(state)
        count = state[..., -1:] + 1
        vector = self.standard(self._summary(total.double() / count))
        return vector.to(features.dtype), torch.cat([total, count], dim=-1)

    def _mean(self, features: Tensor, mask: Tensor) -> Tensor:
        terms = cleared(features[..., self.features.signals :], mask).double()
        return terms.sum(1) / mask.sum(1).clamp(min=1).unsqueeze(-1)

    def _summary(self, mean: Tensor) -> Tensor:
        """x of the mean terms (B, F + S)."""
        size, signals = self.features.sensitivities, self.features.signals
        parts = [mean[..., :signals]] if self.averages else []
        if size:
            score, information = mean[..., signals : signals + size], mean[..., signals + size :]
            row, column = torch.triu_indices(size, size, device=mean.device)
            H = mean.new_zeros(*mean.shape[:-1], size, size)
            H[..., row, column] = information
            H[..., column, row] = information
            level = torch.diagonal(H, dim1=-2, dim2=-1).mean(-1)[..., None, None].clamp(min=1e-30)
            ridge = RIDGE * level * torch.eye(size, dtype=mean.dtype, device=mean.device)
            parts.append(torch.linalg.solve(H + ridge, score.unsqueeze(-1)).squeeze(-1))
        return torch.cat(parts, dim=-1)
