"""Several trajectories of one system -> one vector: the mean of their own vectors, and how many there are.

    e = [1/n sum_i e(x_i), log n]

The order does not count, and any number can be given (Zaheer et al. 2017, "Deep Sets"). An estimator that learns from
sets of all sizes knows how much sharper n trajectories make it; a product of single posteriors counts their common
errors n times.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.embeddings.base import Embedding, SetEmbedding


class PooledEmbedding(SetEmbedding):
    """Pools the vectors of an embedding of single trajectories.

    Args:
        member: embeds each trajectory; its weights are trained with the rest.
    """

    def __init__(self, member: Embedding) -> None:
        super().__init__(member.features)
        self.member = member
        self.size = member.size + 1

    def scale(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> None:
        """Scale what the member scales, from these features."""
        self.member.scale(features, mask)

    def encode_set(self, features: Float[Tensor, "G n T F"], mask: Bool[Tensor, "G n T"]) -> Float[Tensor, "G E"]:
        """Embed sets of features made before; see :meth:`SetEmbedding.encode_set`."""
        vectors = self.member.encode(features.flatten(0, 1), mask.flatten(0, 1)).unflatten(0, mask.shape[:2])
        recorded = mask.any(-1).to(vectors)
        count = recorded.sum(1, keepdim=True).clamp_min(1)
        mean = torch.einsum("gne,gn->ge", vectors, recorded) / count
        return torch.cat([mean, count.log()], dim=-1)
