"""Trajectory -> vector: gated recurrent units over the features of its steps (Cho et al. 2014).

    h_t = GRU(z_t, h_{t-1}),    e = [h_T, mean_t h_t]

As :class:`~onlinebayes.embeddings.LSTMEmbedding`, with three gates in place of four and no cell: a quarter fewer
weights. The hidden row of the stepwise form is (h_t, sum h, t).
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from onlinebayes.embeddings.base import StepwiseEmbedding, check_padding, cleared, last_and_mean
from onlinebayes.embeddings.features import TransitionFeatures


class GRUEmbedding(StepwiseEmbedding):
    """Masked GRU over the features z of a trajectory.

    Args:
        features: what is told about each transition.
        hidden: width H of the GRU; the vector has 2 H values, the hidden row 2 H + 1.
    """

    def __init__(self, features: TransitionFeatures, hidden: int = 64) -> None:
        super().__init__(features)
        self.hidden = hidden
        self.size = 2 * hidden
        self.state_size = 2 * hidden + 1
        self.gru = nn.GRU(features.signals, hidden, batch_first=True)

    def scale(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> None:
        """Nothing: z is standardised already."""

    def encode(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> Float[Tensor, "B E"]:
        """Embed features made before; see :meth:`Embedding.encode`."""
        check_padding(mask)
        return last_and_mean(self.gru(cleared(features[..., : self.features.signals], mask))[0], mask)

    def step(
        self, features: Float[Tensor, "B F"], state: Float[Tensor, "B S"]
    ) -> tuple[Float[Tensor, "B E"], Float[Tensor, "B S"]]:
        """One more transition; see :meth:`StepwiseEmbedding.step`."""
        h, total, count = state.split([self.hidden] * 2 + [1], dim=-1)
        z = features[..., : self.features.signals]
        last = self.gru(z.unsqueeze(1), h.unsqueeze(0).contiguous())[0][:, 0]
        total, count = total + last, count + 1
        return torch.cat([last, total / count], dim=-1), torch.cat([last, total, count], dim=-1)
