"""By how many standard deviations a recording would rule out one model if another is true.

    x^2 = min over d of  (Delta / tau) |r~ - C~ d|^2 + d' I d,      theta + d within the bounds,      separation = x

r~ is what the true model would measure under the input less the other one's replay, cut into windows, their starts
projected out; C~ the other one's sensitivities under the same input; I what the present data say about its parameters
(see ``rivals``). Noise counts as the present residual, correlated over tau, not as the sensor's best.

Linear in d, this is a screening: a model may bend further than its tangent, or less far. :func:`refitted` lets the
other model fit the present data and the predicted ones together, and counts what that costs,

    x^2 = (Delta / tau) (min over theta of |r~|^2 over both  -  min over theta of |r~|^2 over the present data)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.data.windows import MEMORY, Windows, make_windows
from onlinebayes.criticism.experiment.inputs import Inputs
from onlinebayes.criticism.experiment.play import predicted
from onlinebayes.criticism.experiment.rivals import Explanation, Pair, rows_of
from onlinebayes.criticism.fitting.descent import difference_steps
from onlinebayes.criticism.fitting.fit import fit
from onlinebayes.criticism.fitting.projection import project
from onlinebayes.criticism.fitting.sensitivities import linearise
from onlinebayes.criticism.replaying.bounded import bounded_least_squares
from onlinebayes.measurements import Signal
from onlinebayes.runs import BadInput


def separations(
    pair: Pair, inputs: Inputs, present: Windows, signals: Sequence[Signal], noise: Float[Tensor, " S"] | None = None
) -> Float[Tensor, " N"]:
    """Expected separation under each input, to first order; 0 where the other model's replay diverges.

    Args:
        pair: who is true, and who is to be ruled out.
        inputs: N of them.
        present: windows of the present data.
        signals: what is measured under the inputs.
        noise: floor of each of them [SI]; the present data's where they are the same signals.
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
    if not lin.valid:
        return inputs.command.new_zeros(inputs.count)
    extra = len(signals) - len(other.weight)
    weight = torch.cat([other.weight, other.weight.new_ones(extra)])
    projected = project(windows, lin, weight)
    found = []
    for n in range(inputs.count):
        r, C = rows_of(projected, (windows.run == n).nonzero()[:, 0])
        found.append(_least(r, C, windows.bin_step / max(other.tau, windows.bin_step), other))
    return torch.stack(found)


def _least(r: Float[Tensor, " m"], C: Float[Tensor, "m P"], share: float, other: Explanation) -> Float[Tensor, ""]:
    space, theta = other.hypothesis.simulator.parameters, other.hypothesis.theta
    normal, gradient = share * (C.T @ C) + other.information, share * (C.T @ r)
    step = bounded_least_squares(normal, gradient, space.low.to(theta) - theta, space.high.to(theta) - theta)
    square = share * r.square().sum() - 2 * gradient @ step + step @ normal @ step
    return square.clamp_min(0.0).sqrt()


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
    """What the truth would measure under the inputs, cut like the present data; run n is input n."""
    model = pair.other.hypothesis.simulator
    measurement = predicted(pair.truth, inputs, signals, model.commands)
    return make_windows(model, measurement, present.horizon, MEMORY * present.horizon, noise)


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
        free=both("free"),
        runs=(*present.runs, *(f"predicted {name}" for name in new.runs)),
        begin=(*present.begin, *new.begin),
        pasts=(*present.pasts, *new.pasts),
    )
