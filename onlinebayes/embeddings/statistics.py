"""Trajectory -> vector: the summary statistics of BayesSim (Eq 4.20 of the thesis).

    x = (1/T sum_t d_i a_j  for all i, j;   mean_t d;   sd_t d),    d = o' - o
    e = 3 asinh((x - mean) / 3 sd)                       (straight within 3 sd, logarithmic in the tails)

The products of Eq 4.20 are sums over t; here they are divided by T, so that trajectories of different length can be
compared, and the spread is a standard deviation in place of a variance. Nothing here is trained. d and its products are
read off standardised features, which shifts and scales x, and e takes that away again.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.embeddings.base import StepwiseEmbedding, check_padding, cleared
from onlinebayes.embeddings.features import TransitionFeatures
from onlinebayes.embeddings.standard import Standard


class StatisticsEmbedding(StepwiseEmbedding):
    """Standardised statistics of Eq 4.20.

    The hidden row of the stepwise form is (means, sum of the squared deviations of d, t): running means (Welford 1962),
    because the difference of two sums of squares would lose a small spread about a large mean.

    Args:
        features: O observed values, A of the action; the vector has A O + 2 O values.

    Raises:
        ValueError: features without products.
    """

    features: TransitionFeatures

    def __init__(self, features: TransitionFeatures) -> None:
        super().__init__(features)
        if not features.products:
            raise ValueError("the statistics hold products of actions with differences: give features products=True")
        self.differences = features.observation
        self.products = features.action * features.observation
        self.size = self.products + 2 * self.differences
        self.state_size = self.size + 1
        self.standard = Standard(self.size)

    def scale(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> None:
        """Mean and standard deviation of x over trajectories."""
        self.standard.fit(self._statistics(features, mask))

    def encode(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> Float[Tensor, "B E"]:
        """Embed features made before; see :meth:`Embedding.encode`."""
        check_padding(mask)
        vector = self.standard(self._statistics(features, mask)).to(features.dtype)
        return torch.where(mask.any(1, keepdim=True), vector, torch.zeros_like(vector))

    def step(
        self, features: Float[Tensor, "B F"], state: Float[Tensor, "B S"]
    ) -> tuple[Float[Tensor, "B E"], Float[Tensor, "B S"]]:
        """One more transition; see :meth:`StepwiseEmbedding.step`."""
        sizes = [self.products + self.differences, self.differences, 1]
        mean, square, count = state.double().split(sizes, dim=-1)
        count = count + 1
        gap = self._terms(features) - mean
        mean = mean + gap / count
        ahead = gap[..., self.products :]
        square = square + ahead.square() * (1 - 1 / count)
        vector = self.standard(torch.cat([mean, torch.sqrt(square / count)], dim=-1))
        return vector.to(features.dtype), torch.cat([mean, square, count], dim=-1).to(state)

    def _terms(self, features: Tensor) -> Tensor:
        """(a x d, d) of each transition, standardised."""
        signals, first = self.features.signals, self.features.observation + self.features.action
        f = features[..., signals : 2 * signals].double()
        middle, last = first + self.differences, first + self.differences + self.products
        return torch.cat([f[..., middle:last], f[..., first:middle]], dim=-1)

    def _statistics(self, features: Tensor, mask: Tensor) -> Tensor:
        terms = cleared(self._terms(features), mask)
        count = mask.sum(1).clamp(min=1).unsqueeze(-1)
        mean = terms.sum(1) / count
        gap = cleared(terms - mean.unsqueeze(1), mask)[..., self.products :]
        return torch.cat([mean, torch.sqrt(gap.square().sum(1) / count)], dim=-1)
