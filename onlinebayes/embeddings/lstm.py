"""Trajectory -> vector: an LSTM over the features of its steps, beside running means.

    h_t, c_t = LSTM(z_t, h_{t-1}, c_{t-1})           memory of order (Hochreiter and Schmidhuber 1997)
    e = [h_T, mean_t h_t, mean_t phi(z_t)]           phi: a small network of one step, averaged as in a deep set

T is each trajectory's own length; what stands behind it is padding and changes nothing. The averages make the
posterior sharper than h_T alone (a mean forgets nothing) and all three can be carried from step to step:

    code          equation
    hidden        (h_t, c_t, sum h, sum phi, t), one row a trajectory
    ``step``      one more transition
    ``forward``   the whole trajectory at once, equal to ``step`` repeated
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from onlinebayes.embeddings.features import TransitionFeatures


class LSTMEmbedding(nn.Module):
    """Masked LSTM over the features of a trajectory.

    Args:
        features: what is told about each transition; owned by the embedding, and a part of its state.
        hidden: width H of the LSTM and of the averaged network.

    ``size`` is the length of the vector given, 3 H; ``state_size`` that of the hidden row, 4 H + 1.
    """

    def __init__(self, features: TransitionFeatures, hidden: int = 64) -> None:
        super().__init__()
        self.features = features
        self.hidden = hidden
        self.size = 3 * hidden
        self.state_size = 4 * hidden + 1
        self.lstm = nn.LSTM(features.size, hidden, batch_first=True)
        self.single = nn.Sequential(nn.Linear(features.size, hidden), nn.SiLU(), nn.Linear(hidden, hidden), nn.SiLU())

    def forward(
        self,
        observation: Float[Tensor, "B T O"],
        action: Float[Tensor, "B T A"],
        following: Float[Tensor, "B T O"],
        mask: Bool[Tensor, "B T"] | None = None,
    ) -> Float[Tensor, "B E"]:
        """Embed whole trajectories; steps outside ``mask`` (all True when absent) may hold anything, NaN too."""
        if mask is not None:
            observation, action, following = (_cleared(x, mask) for x in (observation, action, following))
        return self.encode(self.features(observation, action, following), mask)

    def encode(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"] | None = None) -> Float[Tensor, "B E"]:
        """Embed features made before; the recorded steps of a trajectory stand in front of its padding.

        Raises:
            ValueError: a mask with a gap, a recorded step behind a padded one.
        """
        batch, time = features.shape[:2]
        if mask is None:
            count = features.new_full((batch,), time)
            outputs, _ = self.lstm(features)
            last, total, single = outputs[:, -1], outputs.sum(1), self.single(features).sum(1)
        else:
            if bool((mask[:, 1:] & ~mask[:, :-1]).any()):
                raise ValueError("a recorded step stands behind a padded one; move the padding to the end")
            features = _cleared(features, mask)
            count = mask.sum(1).to(features)
            outputs, _ = self.lstm(features)
            keep = mask.unsqueeze(-1)
            index = (count.long() - 1).clamp(min=0)
            last = outputs[torch.arange(batch, device=features.device), index] * (count > 0).unsqueeze(-1)
            total, single = (outputs * keep).sum(1), (self.single(features) * keep).sum(1)
        scale = count.clamp(min=1).unsqueeze(-1)
        return torch.cat([last, total / scale, single / scale], dim=-1)

    def initial(self, batch: int) -> Float[Tensor, "B S"]:
        """The hidden rows before the first step: zeros."""
        weight = next(self.lstm.parameters())
        return torch.zeros(batch, self.state_size, dtype=weight.dtype, device=weight.device)

    def step(
        self, features: Float[Tensor, "B F"], state: Float[Tensor, "B S"]
    ) -> tuple[Float[Tensor, "B E"], Float[Tensor, "B S"]]:
        """The vectors after one more transition, and the hidden rows to carry on.

        Args:
            features: ``embedding.features(observation, action, next_observation)`` of this step.
            state: hidden rows, from :meth:`initial` or from the last step.
        """
        h, c, total, single, count = state.split([self.hidden] * 4 + [1], dim=-1)
        output, (h_new, c_new) = self.lstm(
            features.unsqueeze(1), (h.unsqueeze(0).contiguous(), c.unsqueeze(0).contiguous())
        )
        last = output[:, 0]
        total, single, count = total + last, single + self.single(features), count + 1
        embedding = torch.cat([last, total / count, single / count], dim=-1)
        return embedding, torch.cat([h_new[0], c_new[0], total, single, count], dim=-1)


def _cleared(values: Tensor, mask: Tensor) -> Tensor:
    # A product would keep the padding's NaN (and give NaN gradients); a selection does not.
    return torch.where(mask.unsqueeze(-1), values, torch.zeros((), dtype=values.dtype, device=values.device))
