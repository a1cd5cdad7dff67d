"""By how many standard deviations a recording would rule out one model if another is true.

    x^2 = min over d of  (Delta / tau) |r~ - C~ d|^2 + d' I d,      theta + d within the bounds,      separation = x

r~ is what the true model would measure under the input less the other one's replay, cut into windows, their starts
projected out; C~ the other one's sensitivities under the same input; I what the present data say about its parameters
(see ``rivals``). Noise counts as the present residual, correlated over tau, not as the sensor's best.

Linear in d, this is a screening: a model may bend further than its tangent, or less far. :func:`refitted` lets the
other model fit the present data and the predicted ones together, and counts what that costs,

    x^2 = (Delta / tau) (min over theta of |r~|^2 over both  -  min over theta of |r~|^2 over the present data)

An effect is accepted only where it also lowers the error by 5 % (``hypotheses.rule``), over the present data and n
new recordings together:

    fall = 1 - sqrt(S / (S + E)),     S what noise leaves of both,  E what the other one's d for all of them adds
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.criticism.experiment.inputs import Inputs
from onlinebayes.criticism.experiment.play import predicted
from onlinebayes.criticism.experiment.rivals import AdaptableModel, Pair, rows_of
from onlinebayes.identification.data.windows import MEMORY, Windows, make_windows
from onlinebayes.identification.fitting.descent import difference_steps
from onlinebayes.identification.fitting.fit import fit
from onlinebayes.identification.fitting.projection import Projected, project
from onlinebayes.identification.fitting.sensitivities import linearise
from onlinebayes.identification.replaying.bounded import bounded_least_squares
from onlinebayes.measurements import Signal
from onlinebayes.runs import BadInput


@dataclass(frozen=True)
class Separation:
    """What each of N inputs does about one pair.

    Args:
        sigma: expected separation by one recording.
        fall: share by which the effect that is true lowers the error, over the present data and all new recordings; nan
            for a pair that no added effect makes.
    """

    sigma: Float[Tensor, " N"]
    fall: Float[Tensor, " N"]


def separations(
    pair: Pair,
    inputs: Inputs,
    present: Windows,
    signals: Sequence[Signal],
    noise: Float[Tensor, " S"] | None = None,
    plays: int = 1,
) -> Separation:
    """Expected separation under each input, to first order; 0 where the other model's replay diverges.

    Args:
        pair: who is true, and who is to be ruled out.
        inputs: N of them.
        present: windows of the present data.
        signals: what is measured under the inputs.
        noise: floor of each of them [SI]; the present data's where they are the same signals.
        plays: recordings that are fitted, for the fall of the error.
    """
    other = pair.other
    windows = predicted_windows(pair, inputs, present, signals, present.noise if noise is None else noise)
    lin = linearise(
        other.hypothesis.simulator,
        windows,
        other.hypothesis.theta,
        windows.start,
        difference_steps(other.fitted.projected),
    )
    nothing = inputs.command.new_zeros(inputs.count)
    unasked = torch.full_like(nothing, torch.nan)
    if not lin.valid:
        return Separation(nothing, unasked if pair.added is None else nothing)
    extra = len(signals) - len(other.weight)
    weight = torch.cat([other.weight, other.weight.new_ones(extra)])
    projected = project(windows, lin, weight)
    share = windows.bin_step / max(other.tau, windows.bin_step)
    sigma, falls = [], []
    for n in range(inputs.count):
        mine = (windows.run == n).nonzero()[:, 0]
        r, C = rows_of(projected, mine)
        step = _step(r, C, share, other)
        square = share * (r - C @ step).square().sum() + step @ other.information @ step
        sigma.append(square.clamp_min(0.0).sqrt())
        falls.append(unasked[0] if pair.added is None or extra else _fall(projected, mine, share, other, plays))
    return Separation(torch.stack(sigma), torch.stack(falls))


def _step(
    r: Float[Tensor, " m"], C: Float[Tensor, "m P"], share: float, other: AdaptableModel, plays: int = 1
) -> Float[Tensor, " P"]:
    """How the other model's parameters adapt to so many equal recordings, kept by what the present data say."""
    space, theta = other.hypothesis.simulator.parameters, other.hypothesis.theta
    normal, gradient = plays * share * (C.T @ C) + other.information, plays * share * (C.T @ r)
    return bounded_least_squares(normal, gradient, space.low.to(theta) - theta, space.high.to(theta) - theta)


def _fall(
    new: Projected, mine: Int[Tensor, " V"], share: float, other: AdaptableModel, plays: int
) -> Float[Tensor, ""]:
    """Fall of the error, in noise units as acceptance takes it: what the other model misses beyond noise goes."""
    r, C = rows_of(new, mine)
    step, old = _step(r, C, share, other, plays), other.fitted.projected

    def square(projected: Projected, rows: Float[Tensor, "V m"]) -> Float[Tensor, ""]:
        return (projected.measured_rows(rows) / projected.weight).square().sum()

    # Each new window is as noisy as the present ones are on average; what adapting costs there counts, too.
    noise = square(old, old.residual) * (1 + plays * len(mine) / len(old.residual))
    missed = plays * square(new, new.residual[mine] - new.columns[mine] @ step) + square(old, old.columns @ step)
    return 1 - (noise / (noise + missed)).sqrt()


def refitted(pair: Pair, inputs: Inputs, present: Windows, signals: Sequence[Signal]) -> float:
    """Separation under one input, the other model fitted anew to the present data and the predicted ones together."""
    other = pair.other
    new = predicted_windows(pair, inputs, present, signals, present.noise)
    both = _joined(present, new)
    starts = torch.cat([other.fitted.lin.starts, new.start])
    model = other.hypothesis
    try:
        fitted = fit(model.simulator, both, model.theta, other.weight, starts)
    except BadInput:
        return 0.0
    share = new.bin_step / max(other.tau, new.bin_step)
    return (share * max(0.0, fitted.projected.objective - other.fitted.projected.objective)) ** 0.5


def predicted_windows(
    pair: Pair, inputs: Inputs, present: Windows, signals: Sequence[Signal], noise: Float[Tensor, " S"]
) -> Windows:
    """What the truth would measure under the inputs, cut like the present data; run n is input n.

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


def _joined(present: Windows, new: Windows) -> Windows:
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
    """How many rows after its row each value was measured (W, K, S)."""
    return torch.zeros_like(windows.value) if windows.late is None else windows.late
