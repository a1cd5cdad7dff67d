"""Effects that the model carries already, begun where the search would begin them as candidates.

A first fit begins at neutral values and at a few points of the box. Of an effect that is not small-signal linear it may
end in a wrong valley: one draw in fifty lies within cogging's right period. Where more than noise is left, such an
effect is therefore taken out, screened over its starting values, refitted from the best of them as any candidate is,
and put back where that leaves less.

    fit of all -> without the effect -> screened, refitted (:mod:`.stage`) -> all of it from there, on the whole ladder
"""

from __future__ import annotations

import contextlib

from onlinebayes.criticism.candidates.survey import Screened, survey
from onlinebayes.criticism.searching.stage import leaves_noise, refit
from onlinebayes.criticism.searching.working_model import carry_theta
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.fit import NOTICED, Fit, fit
from onlinebayes.identification.fitting.numerics import Grounds, settle
from onlinebayes.identification.fitting.projection import misfit
from onlinebayes.identification.results import Selection
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.identifiable import Identifiable


def begun_as_candidates(
    grounds: Grounds, simulator: Identifiable, measurement: Measurement, selection: Selection
) -> Grounds:
    """The base model with its own effects begun as candidates; as it was fitted where that leaves no less.

    Args:
        grounds: the base model fitted.
        simulator: the base model at its own step.
        measurement: the fit runs.
        selection: how effects are judged.
    """
    fitted, windows = grounds.fitted, grounds.windows
    for effect in fitted.simulator.effects:
        if leaves_noise(fitted, windows, selection.tolerance):
            break
        if effect.starts:
            fitted = _from_its_starts(fitted, windows, effect, selection)
    if fitted is grounds.fitted:
        return grounds
    # The rung of a wrong fit may be one that a right one need not have, or cannot bear.
    try:
        again = settle(simulator, measurement, selection.horizon_s, windows.noise, fitted.theta)
    except BadInput:  # it was stopped: the base model is fitted already
        return grounds
    return again if misfit(again.fitted.projected) < misfit(grounds.fitted.projected) else grounds


def _from_its_starts(fitted: Fit, windows: Windows, effect: Effect, selection: Selection) -> Fit:
    """The same model, the effect begun at the starting values that screening prefers; itself where that is no better.

    Input stages act in the order in which they were added, so that in the end the model itself is fitted once more.
    """
    model, weight = fitted.simulator, fitted.projected.weight
    try:
        leaner = model.without_effect(effect.key)
        current = fit(leaner, windows, carry_theta(model, fitted.theta, leaner), weight, fitted.lin.starts)
        (screened,) = survey(current, windows, [effect], selection.folds).screened
        if screened.p_value is None:  # the other parameters do the same
            return fitted
        found = _refitted(current, windows, screened, selection.tolerance)
        again = fit(model, windows, carry_theta(found.simulator, found.theta, model), weight, found.lin.starts)
    except BadInput:  # it diverges without the effect, or from there, or cannot do without
        return fitted
    return again if again.projected.objective < (1 - NOTICED) * fitted.projected.objective else fitted


def _refitted(current: Fit, windows: Windows, screened: Screened, tolerance: float) -> Fit:
    """The model with the effect again, from the best starting value and, while more than noise is left, the others."""
    found, _ = refit(current, windows, screened.effect, screened.start, promised=screened.promise)
    for start in screened.others:
        if leaves_noise(found, windows, tolerance):
            break
        with contextlib.suppress(BadInput):  # it diverges from there
            other, _ = refit(current, windows, screened.effect, start, found.projected.objective)
            found = min(found, other, key=lambda one: one.projected.objective)
    return found
