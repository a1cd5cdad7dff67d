"""Does a bound exclude the truth? One bound widened alone, everything refitted, against the best effect.

A parameter presses on a bound when its mode lies on it. The bound excludes the truth when the model with that bound
alone widened (i) predicts left-out blocks better than the base model by two standard errors, its error falling by 5 %;
(ii) is not beaten by the best effect by more than two paired standard errors; (iii) leaves no more than noise.

How far is wide: ten times the distance between the bounds. A bound at zero stays (friction, mass and time are never
negative), a positive low one goes down to a tenth. Constants of nature (``option.*``: gravity) are never widened: a
free fall in air would ask for a weaker one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

from onlinebayes.criticism.judging.acceptance import LEAST_FALL
from onlinebayes.criticism.judging.score import STANDARD_ERRORS, cross_validate, score_gain
from onlinebayes.criticism.judging.verdict import left_over
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.stage import Stage
from onlinebayes.identification.fitting.fit import Fit, fit
from onlinebayes.identification.fitting.numerics import Grounds, settle
from onlinebayes.parameters import Parameter
from onlinebayes.runs import BadInput
from onlinebayes.simulators.identifiable import Identifiable

WIDER = 10.0
ON_BOUND = 1e-6  # of the range


@dataclass(frozen=True)
class Widened:
    """A base model with one bound widened.

    Args:
        name: the parameter.
        before, after: its bounds.
        grounds: the model fitted within the wider ones.
    """

    name: str
    before: Parameter
    after: Parameter
    grounds: Grounds


def excluded(simulator: Identifiable, context: SearchContext, base: Grounds, stage: Stage) -> Widened | None:
    """The bound that excludes the truth, if one does; of several the one that predicts best.

    Args:
        simulator: the base model at its own step.
        context: of the search.
        base: the base model fitted.
        stage: the first round of the search, every leading effect judged.
    """
    found: list[tuple[float, Widened]] = []
    for name, wider in pressed(base.fitted):
        try:
            fitted = fit(
                base.fitted.simulator.with_bounds(name, wider),
                base.windows,
                base.fitted.theta,
                base.fitted.projected.weight,
                base.fitted.lin.starts,
            )
        except BadInput:  # such a model diverges, or its bounds are fixed
            continue
        scores = cross_validate(fitted, base.windows, stage.blocks)
        gain = score_gain(scores, stage.scores, base.windows.bin_step)
        fall = 1 - scores.rms_long / stage.scores.rms_long
        if fall < LEAST_FALL or not gain.clear:
            continue
        if stage.judged:
            best = max(stage.judged, key=lambda judged: judged.gain.gain)
            over = score_gain(best.scores, scores, base.windows.bin_step)
            if over.gain > STANDARD_ERRORS * over.se:
                continue
        model = simulator.with_bounds(name, wider)
        horizon, noise = context.selection.horizon_s, base.windows.noise
        settled = settle(model, context.measurement, horizon, noise, fitted.theta, before=base, fitted=fitted)
        if max(left_over(settled).values(), default=0.0) <= context.selection.tolerance:
            found.append((gain.gain, Widened(name, simulator.parameters[name], wider, settled)))
    return max(found, key=lambda item: item[0])[1] if found else None


def pressed(fitted: Fit) -> Iterator[tuple[str, Parameter]]:
    """The parameters whose mode lies on a bound that may be widened, with the wider bounds."""
    for name, value in zip(fitted.simulator.parameters, fitted.theta.tolist(), strict=True):
        bounds = fitted.simulator.parameters[name]
        if name.startswith("option.") or "@" in name:
            continue
        width = bounds.high - bounds.low
        if value >= bounds.high - ON_BOUND * width:
            yield name, dataclasses.replace(bounds, high=bounds.high + WIDER * width)
        elif value <= bounds.low + ON_BOUND * width and bounds.low != 0:
            low = bounds.low / WIDER if bounds.low > 0 else bounds.low - WIDER * width
            yield name, dataclasses.replace(bounds, low=low)
