"""Two effects that are missing at once: one of them can look weak while the other's misfit stands in its way.

A and B are accepted together when each may be added to the model that holds the other: all rules of ``acceptance`` for
B in the model with A, and for A in the model with B. Each of the two tests is one on its own, its p of the maximum over
all candidates included. Tried among the leading ones of a round in which none was admissible alone.

A screening costs less than a refit: each leading one's model is screened first, and two leading ones are refitted
together only where either is significant beside the other.
"""

from __future__ import annotations

from collections.abc import Sequence

from onlinebayes.criticism.candidates.survey import Survey, survey
from onlinebayes.criticism.judging.acceptance import Judged
from onlinebayes.criticism.judging.score import cross_validate, parted, score_gain
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.stage import MOST_REFITS_OF_A_ROUND, Added, Stage, judged_stage, refit, worth
from onlinebayes.identification.fitting.fit import Fit
from onlinebayes.identification.replaying.scoped import effect_values
from onlinebayes.identification.results import Numerics, Selection
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Effect


def find_pair(
    stage: Stage,
    effects: Sequence[Effect],
    numerics: Numerics,
    context: SearchContext,
) -> tuple[Added, Added] | None:
    """The two effects that need each other and predict best together, the stronger one first; None without any.

    Of the pairs within two paired standard errors of the best the one with the fewest parameters, as for single
    effects: a spring with a far rest position can stand for a constant load.

    Args:
        stage: a round without an admissible candidate; its judged ones are tried, the best gain first.
        effects: all candidates of that round.
        numerics: as of that round.
        context: of the search; its watch is looked at between screenings and leads, and what is left is not tried then.
    """
    selection, watch = context.selection, context.watch
    beside: dict[str, Survey] = {}
    for lead in sorted(stage.judged, key=lambda judged: -judged.gain.gain):
        if watch.stopped:
            return None
        watch.say(f"screening beside {lead.effect.key}")
        beside[lead.effect.key] = _beside(lead.fitted, lead.effect, stage, effects, selection)
    found: dict[frozenset[str], tuple[Added, Added]] = {}
    for lead in sorted(stage.judged, key=lambda judged: -judged.gain.gain):
        wanted = [
            s
            for s in worth(beside[lead.effect.key], selection.alpha, selection.alpha)
            if s.effect.key not in beside or _wants(beside[s.effect.key], lead.effect, selection)
        ][:MOST_REFITS_OF_A_ROUND]
        if not wanted or watch.stopped:
            continue
        watch.say(f"pairs with {lead.effect.key}")
        both = judged_stage(beside[lead.effect.key], wanted, numerics, selection, watch.quiet)
        for second in (judged for judged in both.judged if judged.admissible):
            keys = frozenset((lead.effect.key, second.effect.key))
            if keys not in found and _needs(stage, lead, second, beside, effects, numerics, selection):
                found[keys] = ((stage, lead), (both, second))
    if not found:
        return None
    # All on the round's own blocks: what a lead leaves may be correlated for shorter, and make more of them.
    scores = {keys: cross_validate(pair[1][1].fitted, stage.windows, stage.blocks) for keys, pair in found.items()}
    step = stage.windows.bin_step
    best = max(found, key=lambda keys: score_gain(scores[keys], stage.scores, step).gain)
    rivals = [pair for keys, pair in found.items() if keys == best or not parted(scores[best], scores[keys], step)]
    return min(rivals, key=_size)


def _needs(
    stage: Stage,
    lead: Judged,
    second: Judged,
    beside: dict[str, Survey],
    effects: Sequence[Effect],
    numerics: Numerics,
    selection: Selection,
) -> bool:
    """Whether the model that holds ``second`` alone admits ``lead``."""
    survey = beside.get(second.effect.key)
    if survey is None:
        values = effect_values(second.fitted.simulator, second.fitted.theta, second.effect)
        try:
            alone, _ = refit(stage.current, stage.windows, second.effect, values)
        except BadInput:  # without the other it diverges
            return False
        survey = _beside(alone, second.effect, stage, effects, selection)
    wanted = [s for s in worth(survey, selection.alpha, selection.alpha) if s.effect.key == lead.effect.key]
    back = judged_stage(survey, wanted, numerics, selection)
    return any(judged.admissible for judged in back.judged)


def _wants(survey: Survey, effect: Effect, selection: Selection) -> bool:
    return any(s.effect.key == effect.key for s in worth(survey, selection.alpha, selection.alpha))


def _size(pair: tuple[Added, Added]) -> int:
    return sum(len(judged.effect.parameters) for _, judged in pair)


def _beside(fitted: Fit, held: Effect, stage: Stage, effects: Sequence[Effect], selection: Selection) -> Survey:
    """All other candidates, screened on top of the model that holds one effect already."""
    rest = [effect for effect in effects if effect.key != held.key]
    return survey(fitted, stage.windows, rest, selection.folds)
