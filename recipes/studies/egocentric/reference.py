"""The reference: a recurrent network of the four outcomes, from which the best choice at any lambda and cost follows.

    p(motion right?, vision right? | seconds 1 ... t) = softmax(W LSTM(f(s_1), ..., f(s_t)))
    vision where  gain(p, lambda) > cost                              (see ``envs.egocentric.gain``)

It is fitted by likelihood, with the answers to both sensors at hand in every second, which no policy has that learns
from the reward of what it chose.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from envs.egocentric import Stretches

UNITS, NOISE = 64, 0.3


class OutcomeNetwork(nn.Module):
    """Features (E, T, F) -> log probabilities (E, T, 4) of (both wrong, vision right, motion right, both right)."""

    def __init__(self, features: int) -> None:
        super().__init__()
        self.encoder = nn.Sequential(nn.Linear(features, UNITS), nn.Tanh(), nn.Dropout(0.3))
        self.lstm = nn.LSTM(UNITS, UNITS, batch_first=True)
        self.head = nn.Sequential(nn.Dropout(0.3), nn.Linear(UNITS, 4))

    def forward(self, features: Float[Tensor, "E T F"]) -> Float[Tensor, "E T 4"]:
        """Log probabilities."""
        return self.head(self.lstm(self.encoder(features))[0]).log_softmax(-1)


def fit_outcomes(learnt: Stretches, seed: int, *, epochs: int = 30, batch: int = 64) -> OutcomeNetwork:
    """The network, fitted to stretches whose features are blurred a little each time they are seen."""
    torch.manual_seed(seed)
    model, there, number = OutcomeNetwork(learnt.features.shape[-1]), learnt.there, len(learnt.length)
    optimiser = torch.optim.AdamW(model.parameters(), 5e-3, weight_decay=1e-2, fused=True)
    steps = epochs * -(-number // batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 5e-3, total_steps=steps)
    for _ in range(epochs):
        for rows in torch.randperm(number).split(batch):
            seen = learnt.features[rows] + NOISE * torch.randn_like(learnt.features[rows])
            told, vision = model(seen), learnt.vision_rate[rows]
            first = 2 * learnt.motion_right[rows].long()[..., None]
            expected = vision * told.gather(-1, first + 1)[..., 0] + (1 - vision) * told.gather(-1, first)[..., 0]
            optimiser.zero_grad()
            (-expected[there[rows]].mean()).backward()
            optimiser.step()
            schedule.step()
    return model.eval()


@torch.no_grad()
def outcomes(model: OutcomeNetwork, seen: Stretches) -> Float[Tensor, "E T 4"]:
    """Probabilities of the four outcomes."""
    return model(seen.features).exp()
