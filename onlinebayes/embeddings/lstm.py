"""Trajectory -> vector: an LSTM over the features of its steps (Hochreiter and Schmidhuber 1997).

    h_t, c_t = LSTM(z_t, h_{t-1}, c_{t-1}),    e = [h_T, mean_t h_t]

T is each trajectory's own length; what stands behind it is padding and changes nothing. The mean forgets nothing, and
makes posteriors sharper than h_T alone. The hidden row of the stepwise form is (h_t, c_t, sum h, t).
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from onlinebayes.embeddings.base import StepwiseEmbedding, check_padding, cleared, last_and_mean
from onlinebayes.embeddings.features import TransitionFeatures


class LSTMEmbedding(StepwiseEmbedding):
    """Masked LSTM over the features z of a trajectory.

    Args:
        features: what is told about each transition.
        hidden: width H of the LSTM; the vector has 2 H values, the hidden row 3 H + 1.
    """

    def __init__(self, features: TransitionFeatures, hidden: int = 64) -> None:
        super().__init__(features)
        self.hidden = hidden
        self.size = 2 * hidden
        self.state_size = 3 * hidden + 1
        self.lstm = nn.LSTM(features.signals, hidden, batch_first=True)

    def scale(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> None:
        """Nothing: z is standardised already."""

    def encode(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> Float[Tensor, "B E"]:
        """Embed features made before; see :meth:`Embedding.encode`."""
        check_padding(mask)
        return last_and_mean(self.lstm(cleared(features[..., : self.features.signals], mask))[0], mask)

    def step(
        self, features: Float[Tensor, "B F"], state: Float[Tensor, "B S"]
    ) -> tuple[Float[Tensor, "B E"], Float[Tensor, "B S"]]:
        """One more transition; see :meth:`StepwiseEmbedding.step`."""
        h, c, total, count = state.split([self.hidden] * 3 + [1], dim=-1)
        z = features[..., : self.features.signals]
        output, (h_new, c_new) = self.lstm(z.unsqueeze(1), (h.unsqueeze(0).contiguous(), c.unsqueeze(0).contiguous()))
        last = output[:, 0]
        total, count = total + last, count + 1
        return torch.cat([last, total / count], dim=-1), torch.cat([h_new[0], c_new[0], total, count], dim=-1)
