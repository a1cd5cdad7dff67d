"""A learning rate that falls in a line to zero.

    rate <- max(rate - rate_0 n / N, 0)    after n further frames;  N the frames over which it falls

What is left of it stands in the optimiser's state: a run that goes on goes on with it.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import torch


@runtime_checkable
class Annealed(Protocol):
    """The interface of settings with a learning rate."""

    @property
    def learning_rate(self) -> float:
        """rate_0, above 0."""

    @property
    def anneal_frames(self) -> int | None:
        """N; None where the rate stays."""


def anneal(optimiser: torch.optim.Optimizer, settings: Annealed, frames: int) -> None:
    """Lower the learning rate by what some frames cost.

    Args:
        optimiser: whose rate falls.
        settings: say from where, and over how many frames.
        frames: n, that were learnt from since the last call.
    """
    if settings.anneal_frames is None:
        return
    for group in optimiser.param_groups:
        group["lr"] = max(group["lr"] - settings.learning_rate * frames / settings.anneal_frames, 0.0)
