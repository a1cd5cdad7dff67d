"""The error of each window where nothing is fitted: RMS of its replay from its smoothed start [floors]."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.replaying.replay import replay
from onlinebayes.simulators.identifiable import Identifiable


def replay_rms(
    simulator: Identifiable, windows: Windows, thetas: Float[Tensor, "M P"], floor: Float[Tensor, " S"]
) -> Float[Tensor, "M W"]:
    """The error of every window under each theta; infinite where it diverged.

    Args:
        simulator: the model.
        windows: what it is held against.
        thetas: parameters [SI].
        floor: of each signal [SI].
    """
    starts = windows.start.expand(len(thetas), *windows.start.shape)
    signals, valid = replay(simulator, windows, thetas, starts)
    wrong = torch.where(windows.observed, (windows.value - signals) / floor, torch.zeros_like(signals)).square()
    seen = windows.observed.sum((1, 2)).clamp_min(1)
    rms = (wrong.sum((2, 3)) / seen).sqrt()
    return torch.where(valid, rms, torch.full_like(rms, math.inf))
