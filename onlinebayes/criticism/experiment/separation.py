"""The evidence that a recording would give against one model if another is true.

    d = argmin of |C~ d|^2 over the present data + |r~ - C~ d|^2 over the new ones,       theta + d within the bounds
    x^2 = (Delta / tau) sum over both of missed^2 / m            separation x [standard deviations], by one recording
    gain = S(m + missed^2) - S(m)       in the score of :mod:`.judging.scoring`, over the present data and n recordings

r~ is what the true model would measure under the input less the other one's replay, cut into windows, their starts
projected out; C~ the other one's sensitivities under the same input; missed is what d leaves of the first and spoils of
the second, in sensor noise; m the mean square of what the present fit leaves, at least 1, correlated over tau.

Linear in d, this is a screening: a model may bend further than its tangent, or less far. :func:`refitted` lets the
other model fit the present data and the predicted ones together, and counts what that costs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.criticism.experiment.inputs import Inputs
from onlinebayes.criticism.experiment.play import predicted
from onlinebayes.criticism.experiment.rivals import AdaptableModel, Pair
from onlinebayes.identification.data.windows import MEMORY, Windows, make_windows
from onlinebayes.identification.fitting.gauss_newton import fit
from onlinebayes.identification.fitting.rows import Rows, band_counts, band_squares, project
from onlinebayes.identification.fitting.sensitivities import linearise
from onlinebayes.identification.fitting.theta import room
from onlinebayes.identification.judging.scoring import score_parts
from onlinebayes.identification.replaying.bounded import bounded_least_squares
from onlinebayes.measurements import Signal
from onlinebayes.runs import BadInput


@dataclass(frozen=True)
class Separation:
    """The separation of one pair by each of N inputs.

    Args:
        sigma: expected separation by one recording.
        gain: by how much the truth predicts the present data and all new recordings better [nats].
    """

    sigma: Float[Tensor, " N"]
    gain: Float[Tensor, " N"]


def separations(
    pair: Pair,
    inputs: Inputs,
    signals: Sequence[Signal],
    noise: Float[Tensor, " S"] | None = None,
    plays: int = 1,
) -> Separation:
    """Expected separation under each input, to first order; 0 where the other model's replay diverges.

    Args:
        pair: who is true, and who is to be ruled out.
        inputs: N of them.
        signals: what is measured under the inputs: the present ones, and some more.
        noise: floor of each of them [SI]; the present data's where they are the same signals.
        plays: recordings that are judged, for the gain.
    """
    other = pair.other
    new = predicted_windows(pair, inputs, other.windows, signals, other.windows.noise if noise is None else noise)
    model = other.hypothesis
    lin = linearise(model.simulator, new, model.theta, new.start)
    if not lin.valid:
        nothing = inputs.command.new_zeros(inputs.count)
        return Separation(nothing, nothing)
    rows = project(new, lin, _with_more(other, other.fitted.rows.weight, len(signals)))
    each = [(new.run == n).nonzero()[:, 0] for n in range(inputs.count)]
    sigma = [_sigma(other, *_missed(other, rows, mine, 1)) for mine in each]
    gain = [_gain(other, new.select(mine), *_missed(other, rows, mine, plays), plays) for mine in each]
    return Separation(torch.stack(sigma), torch.stack(gain))


def _with_more(other: AdaptableModel, weight: Float[Tensor, "n S"], signals: int) -> Float[Tensor, "n S2"]:
    """The weights, and for signals that are not measured yet those of a residual that is noise."""
    more = (2.0 * other.windows.count * len(weight)) ** -0.5
    return torch.cat([weight, weight.new_full((len(weight), signals - weight.shape[1]), more)], dim=1)


def _missed(
    other: AdaptableModel, new: Rows, mine: Int[Tensor, " V"], plays: int
) -> tuple[Float[Tensor, "V n S2"], Float[Tensor, "W n S"]]:
    """Return what the other model leaves of a recording when it adapts to so many, and spoils of the present data."""
    old, model = other.fitted.rows, other.hypothesis
    C, r, kept = new.columns[mine].flatten(0, 1), new.residual[mine].flatten(), old.columns.flatten(0, 1)
    normal, gradient = plays * (C.T @ C) + kept.T @ kept, plays * (C.T @ r)
    step = bounded_least_squares(normal, gradient, *room(model.simulator, model.theta))
    return new.in_noise(new.residual[mine] - new.columns[mine] @ step), old.in_noise(old.columns @ step)


def _sigma(other: AdaptableModel, missed: Float[Tensor, "V n S2"], spoilt: Float[Tensor, "W n S"]) -> Float[Tensor, ""]:
    noise = other.noise
    more = torch.cat([noise, noise.new_ones(len(noise), missed.shape[2] - noise.shape[1])], dim=1)
    return (_share(other) * ((missed.square() / more).sum() + (spoilt.square() / noise).sum())).sqrt()


def _share(other: AdaptableModel) -> float:
    """Return the number of independent values that a bin is worth: Delta / tau, at most 1."""
    return other.windows.bin_step / max(other.tau, other.windows.bin_step)


def _gain(
    other: AdaptableModel,
    new: Windows,
    missed: Float[Tensor, "V n S2"],
    spoilt: Float[Tensor, "W n S"],
    plays: int,
) -> Float[Tensor, ""]:
    """By how much worse the score is for what is missed and spoilt; of the signals that are measured now."""
    S = spoilt.shape[2]
    squares, counts = band_squares(other.windows, other.left).sum(0), band_counts(other.windows).sum(0)
    mean, more = squares / counts.clamp_min(1), plays * band_counts(new).sum(0)[:, :S]
    noise, counts = squares + mean * more, counts + more
    worse = plays * band_squares(new, missed).sum(0)[:, :S] + band_squares(other.windows, spoilt).sum(0)
    return (score_parts(noise + worse, counts) - score_parts(noise, counts)).sum()


def refitted(pair: Pair, inputs: Inputs, signals: Sequence[Signal]) -> float:
    """Separation under one input, the other model fitted anew to the present data and the predicted ones together."""
    other, model, W = pair.other, pair.other.hypothesis, pair.other.windows.count
    new = predicted_windows(pair, inputs, other.windows, signals, other.windows.noise)
    both, starts = joined(other.windows, new), torch.cat([other.fitted.lin.starts, new.start])
    try:
        found = fit(model.simulator, both, model.theta, starts, rough=other.fitted.rough)
    except BadInput:
        return 0.0
    left, noise = found.rows.in_noise(found.rows.residual).square() / other.noise, other.left.square() / other.noise
    return (_share(other) * max(0.0, float(left[W:].sum() + left[:W].sum() - noise.sum()))) ** 0.5


def predicted_windows(
    pair: Pair, inputs: Inputs, present: Windows, signals: Sequence[Signal], noise: Float[Tensor, " S"]
) -> Windows:
    """Predict the windows of a recording of the truth under the inputs, cut like the present data; run n is input n.

    Sensors measure as often as in the present data, whose replay may have rows between; added ones as the quickest.
    """
    model = pair.other.hypothesis.simulator
    measurement = predicted(pair.truth, inputs, signals, model.commands)
    new = make_windows(model, measurement, present.horizon, MEMORY * present.horizon, noise)
    apart = _rows_apart(present)
    apart = torch.cat([apart, apart.amin().expand(len(signals) - len(apart))])
    row = new.first[:, None, None] + torch.arange(1, new.rows + 1, device=new.first.device)[:, None]
    shown = row % apart == 0
    return replace(new, observed=new.observed & shown, measured=new.measured & shown)


def _rows_apart(windows: Windows) -> Int[Tensor, " S"]:
    """Every how many rows each signal was measured."""
    share = windows.measured[windows.inside].double().mean(0)
    return (1 / share.clamp_min(1 / windows.rows)).round().long()


def joined(present: Windows, new: Windows) -> Windows:
    """Windows of both, the new runs numbered after the present ones."""

    def both(name: str) -> Tensor:
        return torch.cat([getattr(present, name), getattr(new, name)])

    return replace(
        present,
        run=torch.cat([present.run, new.run + len(present.runs)]),
        first=both("first"),
        command=both("command"),
        enable=both("enable"),
        history=both("history"),
        history_enable=both("history_enable"),
        value=both("value"),
        observed=both("observed"),
        measured=both("measured"),
        inside=both("inside"),
        start=both("start"),
        start_sd=both("start_sd"),
        start_prior=both("start_prior"),
        start_given=both("start_given"),
        free=both("free"),
        runs=(*present.runs, *(f"predicted {name}" for name in new.runs)),
        begin=(*present.begin, *new.begin),
        run_histories=(*present.run_histories, *new.run_histories),
        late=None if present.late is None and new.late is None else torch.cat([_lateness(present), _lateness(new)]),
    )


def _lateness(windows: Windows) -> Tensor:
    """Return the delay of each value's measurement after its row [rows] (W, K, S)."""
    return torch.zeros_like(windows.value) if windows.late is None else windows.late
