"""Is it the model that errs on the held-out runs, or are the starts as measured worse than the sensors' noise?

    error:   starts as measured; its floor holds the noise of the sensors that gave them
    left:    the same windows with each start fitted, as in a fit      [noise floors]

A start comes from a smoothed path. Where the motion is jerky (a controller that switches) the smoother rounds it off,
and the replay inherits that: the error is far above its floor, and the model is right all the same.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.data.windows import Windows
from onlinebayes.criticism.fitting.per_run_values import held_out_model
from onlinebayes.criticism.fitting.projection import project, signal_rms, start_shift
from onlinebayes.criticism.fitting.sensitivities import linearise_starts
from onlinebayes.criticism.results import FittedModel, HeldOutError
from onlinebayes.simulators.base import Simulator

FAR = 2.0  # floors: an error that is worth a word
STEPS = 2  # of Newton: starts are nearly linear over a window


def starts_note(final: FittedModel, held: Windows, error: HeldOutError, tolerance: float) -> tuple[str, ...]:
    """What to tell a user whose held-out error is above its floor for the starts alone; nothing where it is not.

    Args:
        final: the model that is reported.
        held: windows of the held-out runs at every row.
        error: over these windows.
        tolerance: what counts as noise [floors].
    """
    floors = error.noise_floor
    # A signal without rows has neither; a floor of zero is nothing to compare with.
    shares = [after / floors[name] for name, after in error.after.items() if floors[name] > 0 and not math.isnan(after)]
    worst = max(shares, default=0.0)
    if not FAR < worst < math.inf:  # it diverged
        return ()
    left = float(left_with_fitted_starts(final.simulator, held, final.theta).max())
    if not left <= tolerance:
        return ()
    return (
        f"the held-out error is up to {worst:.2g} times what noise explains because its starts are taken as measured, "
        f"which is rough where the motion is jerky; with them fitted the model leaves {left:.2g} floors there",
    )


def left_with_fitted_starts(simulator: Simulator, windows: Windows, theta: Float[Tensor, " P"]) -> Float[Tensor, " S"]:
    """RMS of each signal over the windows, each begun at its best start [floors]; inf where the model diverges."""
    model, parts, values = held_out_model(simulator, windows, theta)
    starts = parts.start
    for step in range(STEPS + 1):
        lin = linearise_starts(model, parts, values, starts)
        if not lin.valid:
            return torch.full_like(windows.noise, float("inf"))
        projected = project(parts, lin)
        if step < STEPS:
            starts = lin.starts + start_shift(parts, lin, projected, torch.zeros_like(values))
    return signal_rms(projected)
