"""The motion predictor: an LSTM over the ten readings of one second, and its predictions for seconds it never saw.

    h = LSTM_64((x_1 - m) / s, ..., (x_10 - m) / s),    p(activity) = softmax(W h + b)

Thesis, section 3.3.2: one layer of 64 units. A policy that learns from predictions for seconds that the predictor was
trained on takes the cheap sensor for better than it is; :func:`cross_fitted` gives it the others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from envs.egocentric.sequences import CLASSES, Sequences

UNITS = 64


class MotionPredictor(nn.Module):
    """Readings of a second (N, R, 6) -> log probabilities of the activities (N, 20)."""

    mean: Tensor
    scale: Tensor

    def __init__(self, mean: Float[Tensor, " 6"], scale: Float[Tensor, " 6"], dropout: float = 0.3) -> None:
        super().__init__()
        self.register_buffer("mean", mean)
        self.register_buffer("scale", scale)
        self.lstm = nn.LSTM(len(mean), UNITS, batch_first=True)
        self.head = nn.Sequential(nn.Dropout(dropout), nn.Linear(UNITS, CLASSES))

    def forward(self, signals: Float[Tensor, "N R 6"]) -> Float[Tensor, "N 20"]:
        """Log probabilities."""
        hidden, _ = self.lstm((signals - self.mean) / self.scale)
        return self.head(hidden[:, -1]).log_softmax(-1)


def fit_motion(
    signals: Float[Tensor, "N R 6"],
    label: Int[Tensor, " N"],
    generator: torch.Generator,
    *,
    epochs: int = 30,
    batch: int = 256,
    learning_rate: float = 1e-2,
) -> MotionPredictor:
    """A predictor trained on some seconds.

    Args:
        signals: their readings.
        label: their activities.
        generator: of the first weights and the batches.
        epochs, batch, learning_rate: of Adam, whose rate rises and falls once.
    """
    seen = signals.flatten(0, 1)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(torch.randint(2**31, (), generator=generator)))
        model = MotionPredictor(seen.mean(0), seen.std(0).clamp_min(1e-6))
        optimiser = torch.optim.AdamW(model.parameters(), learning_rate, weight_decay=1e-3, fused=True)
        steps = epochs * -(-len(signals) // batch)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, learning_rate, total_steps=steps)
        for _ in range(epochs):
            for rows in torch.randperm(len(signals)).split(batch):
                optimiser.zero_grad()
                nn.functional.nll_loss(model(signals[rows]), label[rows]).backward()
                optimiser.step()
                schedule.step()
    return model.eval()


def cross_fitted(
    sequences: Sequences,
    fold: Int[Tensor, "S T"],
    tests: Iterable[int],
    fit: Callable[[Tensor, Tensor], nn.Module],
) -> Iterator[Float[Tensor, "S T 20"]]:
    """For each test fold: log probabilities of every second by a predictor trained without its fold and the test fold.

    The test seconds are predicted by a predictor of all other folds. One without folds j and k serves both.

    Args:
        sequences: all of them.
        fold: of each second.
        tests: the folds that are held out, one after the other.
        fit: (signals, label) -> a predictor.
    """
    there, fitted = sequences.there, dict[frozenset[int], nn.Module]()
    for test in tests:
        result = torch.zeros(*fold.shape, CLASSES)
        for k in fold.unique().tolist():
            without = frozenset((k, test))
            if without not in fitted:
                learns = there & (fold != k) & (fold != test)
                fitted[without] = fit(sequences.signals[learns], sequences.labels[learns])
            asked = there & (fold == k)
            result[asked] = predicted(fitted[without], sequences.signals[asked])
        yield result


@torch.no_grad()
def predicted(model: nn.Module, signals: Float[Tensor, "N R 6"]) -> Float[Tensor, "N 20"]:
    """Predict the log probabilities of the activities in some seconds."""
    return model(signals)


def features(sequences: Sequences, log_probability: Float[Tensor, "S T 20"]) -> Float[Tensor, "S T 32"]:
    """Compute a policy's input of a second: the predictor's log probabilities, mean and spread of the six signals.

    Each is standardised over all seconds; the log probabilities are cut off at -8.
    """
    spread = sequences.signals.std(2, correction=0)
    row = torch.cat([log_probability.clamp_min(-8.0), sequences.signals.mean(2), spread], -1)
    seen = row[sequences.there]
    return (row - seen.mean(0)) / seen.std(0).clamp_min(1e-6) * sequences.there[..., None]
