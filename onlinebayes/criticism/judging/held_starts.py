"""Is it the model that errs on the held-out runs, or are the starts as measured worse than the sensors' noise?

    error:   starts as measured; its floor holds the noise of the sensors that gave them
    left:    the same windows with each start fitted, as in a fit      [noise floors]

A start comes from a path smoothed by one local cubic per signal. Where the motion turns faster than that cubic (a
controller that switches, a stretch quicker than the others) the smoother rounds it off by more than the noise alone
would, and the replay inherits that: the error is far above its floor, and the model is right all the same.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.results import HeldOutError
from onlinebayes.identification import quantities
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.per_run_values import held_out_model
from onlinebayes.identification.fitting.projection import project, signal_rms, start_shift
from onlinebayes.identification.fitting.sensitivities import linearise_starts
from onlinebayes.identification.results import FittedModel
from onlinebayes.simulators.identifiable import Identifiable

FAR = 2.0  # floors: an error that is worth a word
NAMED = 3  # signals: more are counted
STEPS = 2  # of Newton: starts are nearly linear over a window


def fitted_starts(final: FittedModel, held: Windows, error: HeldOutError, tolerance: float) -> dict[str, float]:
    """The signals whose held-out error is above its floor for the starts alone, and what fitted starts leave of it.

    Args:
        final: the model that is reported.
        held: windows of the held-out runs at every row.
        error: over these windows.
        tolerance: what counts as noise [floors].

    Returns:
        Signal -> RMS with fitted starts [sensor noise]; empty where any signal then errs by more than noise.
    """
    far = [name for name, share in _over_floor(error).items() if share > FAR]
    if not far or math.inf in error.after.values():  # it diverged
        return {}
    left = left_with_fitted_starts(final.simulator, held, final.theta)
    if not float(left.max()) <= tolerance:
        return {}
    by_signal = dict(zip((final.simulator.signals[c] for c in held.columns), left.tolist(), strict=True))
    return {name: by_signal[name] for name in far}


def starts_note(left: Mapping[str, float], error: HeldOutError) -> tuple[str, ...]:
    """What to tell a user of an error that the starts make; nothing where they do not.

    Args:
        left: of :func:`fitted_starts`.
        error: over the same windows.
    """
    if not left:
        return ()
    worst, still = max(_over_floor(error)[name] for name in left), max(left.values())
    whose = ", ".join(left) if len(left) <= NAMED else f"{len(left)} signals"
    whose = " and ".join(whose.rsplit(", ", 1))
    return (
        f"the held-out error of {whose} is {'up to ' if len(left) > 1 else ''}{quantities.times(worst)} what noise "
        "explains because its windows start from smoothed measurements, which round off quick turns of the motion; "
        f"with the starts fitted, {quantities.times(still)} the sensor noise is left",
    )


def _over_floor(error: HeldOutError) -> dict[str, float]:
    """Error over floor by signal; of those with rows (others have neither) and a floor to compare with."""
    floors = error.noise_floor
    return {
        name: after / floors[name] for name, after in error.after.items() if floors[name] > 0 and not math.isnan(after)
    }


def left_with_fitted_starts(
    simulator: Identifiable, windows: Windows, theta: Float[Tensor, " P"]
) -> Float[Tensor, " S"]:
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
