"""A richer effect that entered takes the place of the simpler one that it contains.

    dry friction F, then Stribeck friction (Fs, Fc, vs):      Stribeck friction alone, from (Fs + F, Fc + F, vs)

Beside each other the two have a free number too many: only their sum is known. The simpler one goes where the model
without it, fitted anew, predicts as well; else both stay.
"""

from __future__ import annotations

from dataclasses import replace

from onlinebayes.criticism.candidates.candidates import grown
from onlinebayes.criticism.judging.acceptance import contained
from onlinebayes.criticism.judging.score import cross_validate
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.stage import blocks_for
from onlinebayes.criticism.searching.working_model import WorkingModel
from onlinebayes.identification.fitting.numerics import Grounds, settle
from onlinebayes.identification.replaying.scoped import effect_entries
from onlinebayes.identification.results import Selection

WORSE = 1.01  # times the cross-validated error with both


def drop_contained(working: WorkingModel, context: SearchContext) -> WorkingModel | None:
    """The model without the effects that its newest one contains; None where there is none, or it is worse.

    Args:
        working: the model with all of them.
        context: of the search.
    """
    current, accepted = working.grounds, working.accepted
    newest, fitted = accepted[-1][1].effect, current.fitted
    kept = tuple(item for item in accepted if item[1].effect.key not in contained(newest))
    if len(kept) == len(accepted):
        return None
    model = grown(working.simulator, [judged.effect for _, judged in kept])
    values = dict(zip(fitted.simulator.parameters, fitted.theta.unbind(), strict=True))
    for _, judged in accepted:
        simpler = list(effect_entries(fitted.simulator, judged.effect))
        if judged.effect.key in contained(newest) and len(simpler) == 1:
            for name, short in effect_entries(model, newest).items():
                if short in newest.absorbs:
                    values[name] = values[name] + values[simpler[0]]
    theta = fitted.theta.new_tensor([float(values[name]) for name in model.parameters])
    selection = context.selection
    alone = settle(model, context.measurement, selection.horizon_s, current.windows.noise, theta, current)
    if _error(alone, selection) > WORSE * _error(current, selection):
        return None
    return replace(working, grounds=alone, accepted=kept)


def _error(grounds: Grounds, selection: Selection) -> float:
    blocks = blocks_for(grounds.fitted, grounds.windows, selection.folds)
    return cross_validate(grounds.fitted, grounds.windows, blocks).rms_long
