"""The mixture density network of the thesis's chapter 4, as printed; only to be compared.

    Phi(x) = tanh(W_2 tanh(W_1 x + b_1) + b_2)          two layers of 24                                   Eq 4.9
    alpha = softmax(W_a Phi + b_a),   mu_k = W_k Phi + b_k,   diag Sigma_k = mELU(V_k Phi + c_k)   Eq 4.4 to 4.6
    mELU(z) = exp(z) for z <= 0, z + 1 above                                              Eq 4.7, its alpha at 1

in the unit cube of the parameters; cut to it, which the thesis's is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import torch
from jaxtyping import Float
from torch import Tensor, nn

from onlinebayes.inference import Box, TruncatedMixture
from onlinebayes.inference.distributions.algebra import doubled, union
from onlinebayes.parameters import ParameterSpace

LEAST = 1e-8
"""Of a variance, in the unit cube: keeps a component from closing on one theta."""


@final
class PublishedNetwork(nn.Module):
    """Vector (B, E) -> mixtures (B,).

    Args:
        space: the parameters.
        embedding: E.
        components: K, ten in chapter 4.
        hidden: width of each layer.
    """

    def __init__(self, space: ParameterSpace, embedding: int, components: int = 10, hidden: int = 24) -> None:
        super().__init__()
        self.space, self.box = space, Box.whole(space)
        self.trunk = nn.Sequential(nn.Linear(embedding, hidden), nn.Tanh(), nn.Linear(hidden, hidden), nn.Tanh())
        self.weight = nn.Linear(hidden, components)
        self.mean = nn.Linear(hidden, components * len(space))
        self.variance = nn.Linear(hidden, components * len(space))

    def distribution(self, embedding: Float[Tensor, "B E"]) -> TruncatedMixture:
        """The mixtures that the vectors stand for."""
        hidden = self.trunk(embedding)
        mean, variance = (head(hidden).unflatten(-1, (-1, len(self.space))) for head in (self.mean, self.variance))
        scale = (nn.functional.elu(variance) + 1 + LEAST).sqrt()
        return TruncatedMixture(self.weight(hidden), 0.5 + mean, torch.diag_embed(scale), self.box)

    def united(self, factors: Sequence[TruncatedMixture]) -> TruncatedMixture:
        """The union of n batches (*G,)."""
        return union([doubled(mixture) for mixture in factors])
