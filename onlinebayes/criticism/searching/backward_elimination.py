"""An accepted effect that later ones made needless: without it the model predicts as well.

    needless:  score_gain(with it over without it) < 2 standard errors,  cross-validated RMS at H lower by less than 5 %

with everything fitted anew. What enters first stands in for whatever was missing then, and may keep a size that is
surely not nothing beside the law that came later. Rules 2 and 3 of :mod:`.judging.acceptance` are asked again
therefore, of every effect but the last, and the one that gains least goes first.
"""

from __future__ import annotations

import math
from dataclasses import replace

from onlinebayes.criticism.candidates.candidates import grown
from onlinebayes.criticism.judging.acceptance import LEAST_FALL
from onlinebayes.criticism.judging.score import CrossValidated, cross_validate, score_gain
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.stage import blocks_for
from onlinebayes.criticism.searching.working_model import WorkingModel, carry_theta
from onlinebayes.identification.fitting.fit import fit
from onlinebayes.identification.fitting.numerics import settle
from onlinebayes.runs import BadInput


def eliminate(working: WorkingModel, context: SearchContext) -> WorkingModel:
    """The model without any effect that it does not need; itself where all are needed.

    Args:
        working: the model with all of them.
        context: of the search.
    """
    while len(working.accepted) > 1:
        leaner = _without_one(working, context)
        if leaner is None:
            break
        working = leaner
    return working


def needed(present: CrossValidated, absent: CrossValidated, bin_step: float) -> bool:
    """Whether a model predicts better than one that has less: rules 2 and 3 of :mod:`.judging.acceptance`."""
    return score_gain(present, absent, bin_step).clear or present.rms_long < (1 - LEAST_FALL) * absent.rms_long


def _without_one(working: WorkingModel, context: SearchContext) -> WorkingModel | None:
    """The model without the effect that it needs least; None where it needs them all."""
    current, windows = working.grounds, working.grounds.windows
    blocks = blocks_for(current.fitted, windows, context.selection.folds)
    present = cross_validate(current.fitted, windows, blocks)
    least, leaner = math.inf, None
    for idle in working.accepted[:-1]:
        kept = tuple(item for item in working.accepted if item is not idle)
        model = grown(working.simulator, [judged.effect for _, judged in kept])
        theta = carry_theta(current.fitted.simulator, current.fitted.theta, model)
        try:
            fitted = fit(current.rung.of(model), windows, theta, starts=current.fitted.lin.starts)
        except BadInput:  # without it the model diverges
            continue
        absent = cross_validate(fitted, windows, blocks)
        gain = score_gain(present, absent, windows.bin_step).gain
        if not needed(present, absent, windows.bin_step) and gain < least:
            least, leaner = gain, (model, fitted, kept)
    if leaner is None:
        return None
    model, fitted, kept = leaner
    horizon, noise = context.selection.horizon_s, windows.noise
    grounds = settle(model, context.measurement, horizon, noise, fitted.theta, current, fitted)
    return replace(working, grounds=grounds, accepted=kept)
