"""An accepted effect gives way to a rival of its own round that predicts better beside what came later.

    a -> r:   r was admissible beside a and not parted from it;  in the final model, everything refitted,
              r's cross-validated error is lower by 1 % or more, and the two are parted (see ``judging.score``)

What enters first enters while other effects are missing. The residual is slow then, two accounts of it are hardly ever
parted, and the one with fewer parameters goes in: a centre of mass for a spring whose centre is free, with a friction
still to be found. Beside the friction the data tell.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from onlinebayes.criticism.candidates.candidates import grown
from onlinebayes.criticism.judging.acceptance import Judged
from onlinebayes.criticism.judging.score import parted, score_gain
from onlinebayes.criticism.judging.verdict import tied
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.rival_fits import Incumbent, can_replace, fit_with_rival, rival_as_judged
from onlinebayes.criticism.searching.stage import Added, Stage
from onlinebayes.criticism.searching.working_model import WorkingModel
from onlinebayes.identification.fitting.fit import Fit
from onlinebayes.identification.fitting.numerics import settle
from onlinebayes.simulators.effects import Effect


def swap_in_better_rival(working: WorkingModel, context: SearchContext) -> WorkingModel | None:
    """The model with a rival in the place of an earlier effect; None where none predicts better.

    Args:
        working: the model, all its effects in it.
        context: of the search.
    """
    if len(working.accepted) < 2:
        return None
    incumbent = Incumbent.on(working.grounds, context.selection.folds)
    most, bin_step = working.grounds.fitted.projected.objective, working.grounds.windows.bin_step
    for k, (stage, accepted) in enumerate(working.accepted[:-1]):
        for rival in _rivals(stage, accepted, working.effects):
            if context.watch.stopped:
                return None
            context.watch.say(f"trying {rival.effect.key} in the place of {accepted.effect.key}")
            taken = (*working.accepted[:k], (stage, rival), *working.accepted[k + 1 :])
            effects = [judged.effect for _, judged in taken]
            fitted = fit_with_rival(rival_as_judged(rival), working.simulator, effects, incumbent, most)
            if fitted is None or fitted.projected.objective >= most:
                continue
            scores, other = incumbent.scores, incumbent.validated(fitted)
            better = score_gain(other, scores, bin_step).gain > 0 and other.rms_long < scores.rms_long
            if better and not tied(scores, other, bin_step):
                return _taken(working, taken, fitted, context)
    return None


def _rivals(stage: Stage, accepted: Judged, present: list[Effect]) -> Iterator[Judged]:
    """What its round might have taken as well."""
    keys = {effect.key for effect in present}
    for other in stage.judged:
        if not other.admissible or not can_replace(accepted.effect, other.effect, keys):
            continue
        if not parted(accepted.scores, other.scores, stage.windows.bin_step):
            yield other


def _taken(working: WorkingModel, taken: tuple[Added, ...], fitted: Fit, context: SearchContext) -> WorkingModel:
    """The working model with the rival's model, at a step that is fine enough for it."""
    model = grown(working.simulator, [judged.effect for _, judged in taken])
    before = working.grounds
    horizon, noise = context.selection.horizon_s, before.windows.noise
    grounds = settle(model, context.measurement, horizon, noise, fitted.theta, before, fitted)
    return replace(working, grounds=grounds, accepted=taken)
