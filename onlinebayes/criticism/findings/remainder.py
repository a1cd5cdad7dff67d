"""The error that a fitted model leaves, over the floor: about 1 where nothing but noise is left."""

from __future__ import annotations

import math

import torch

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.best_starts import best_starts
from onlinebayes.identification.fitting.fit import Fit
from onlinebayes.identification.fitting.projection import row_weights, start_shift
from onlinebayes.identification.replaying.replay import replay
from onlinebayes.identification.results import Numerics


def rms_over_floor(fitted: Fit, windows: Windows, numerics: Numerics) -> dict[str, float]:
    """Start-projected RMS at the rows over the floor, by signal: about 1 where nothing but noise is left.

    Replayed from each window's best start: the fit's own, or where its linearisation says that the best one is. A
    signal without an observed row has 0.

    Args:
        fitted, windows: the model and what it was fitted to.
        numerics: of its integration step; a larger error than the noise is the floor where it cannot be helped. A
            step that is fine enough for a gross misfit was chosen: there the floor is the noise alone, and where
            nobody knows the error, too.
    """
    shift = start_shift(windows, fitted.lin, fitted.projected, torch.zeros_like(fitted.theta))
    candidates = fitted.lin.starts + torch.stack([torch.zeros_like(shift), shift])
    weight = row_weights(windows, torch.ones_like(windows.noise))
    starts, _ = best_starts(fitted.simulator, windows, weight, fitted.theta, candidates)
    signals, _ = replay(fitted.simulator, windows, fitted.theta[None], starts[None])
    seen = windows.observed
    square = torch.where(seen, windows.value - signals[0], torch.zeros_like(windows.value)).square()
    rms = (square.sum((0, 1)) / seen.sum((0, 1)).clamp_min(1)).sqrt()
    known = not numerics.sufficient and math.isfinite(numerics.error_at_quarter_step)
    error = numerics.error_at_quarter_step if known else 0.0
    floor = windows.noise * max(1.0, error)
    names = [fitted.simulator.signals[c] for c in windows.columns]
    return dict(zip(names, (rms / floor).tolist(), strict=True))
