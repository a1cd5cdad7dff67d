"""One law at several places at once: four rotors that lag, three wheels with a dead zone.

One of four lowers the error by little, and its size differs from part to part while the others' misfit stands in its
way. In a round in which nothing is admissible alone, a law that is significant at several places is fitted at all of
them together,

    theta, a_1 .. a_n  ->  fitted,      a_k judged against the model that holds all the others

and accepted where each a_k passes every rule of ``acceptance`` there; p is that of the maximum over all candidates, as
for one effect. Of several such laws the one that predicts best.
"""

from __future__ import annotations

from collections.abc import Sequence

from onlinebayes.criticism.candidates.candidates import grown
from onlinebayes.criticism.candidates.survey import Screened, survey
from onlinebayes.criticism.judging.score import cross_validate, score_gain
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.stage import LEAST_PROMISED_FALL, Added, Stage, judged_in
from onlinebayes.criticism.searching.working_model import carry_theta
from onlinebayes.identification.fitting.fit import Fit, fit
from onlinebayes.identification.fitting.inactive_effects import restart_inactive_effects
from onlinebayes.identification.replaying.scoped import with_effect_values
from onlinebayes.identification.results import Numerics
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Effect

MOST_LAWS = 2  # that are tried in a round


def find_shared_law(
    stage: Stage,
    effects: Sequence[Effect],
    numerics: Numerics,
    context: SearchContext,
) -> list[Added]:
    """The effects of one name that need each other, the strongest first; none where no such law is admissible.

    Args:
        stage: a round without an admissible candidate.
        effects: all candidates of that round.
        numerics: as of that round.
        context: of the search; its watch is looked at between fits, and what is left is then not tried.
    """
    found: list[tuple[float, list[Added]]] = []
    for members in _laws(stage, context.selection.alpha)[:MOST_LAWS]:
        if context.watch.stopped:
            break
        context.watch.say(f"{members[0].effect.name} at {len(members)} places at once")
        try:
            together = _fitted(stage, members)
            added = _judged(stage, members, together, effects, numerics, context)
        except BadInput:  # without one of them, or from where screening would start them, the model diverges
            continue
        if added:
            scores = cross_validate(together, stage.windows, stage.blocks)
            found.append((score_gain(scores, stage.scores, stage.windows.bin_step).gain, added))
    return max(found, key=lambda one: one[0])[1] if found else []


def _laws(stage: Stage, alpha: float) -> list[list[Screened]]:
    """The significant and promising candidates by name, of each name two or more; what promises most in sum first."""
    by_name: dict[str, list[Screened]] = {}
    for one in stage.screened:
        if one.p_value is not None and one.p_value < alpha and one.promise >= LEAST_PROMISED_FALL:
            by_name.setdefault(one.effect.name, []).append(one)
    several = [members for members in by_name.values() if len(members) > 1]
    return sorted(several, key=lambda members: -sum(one.promise for one in members))


def _judged(
    stage: Stage,
    members: Sequence[Screened],
    together: Fit,
    effects: Sequence[Effect],
    numerics: Numerics,
    context: SearchContext,
) -> list[Added]:
    """Every member judged beside the others; nothing as soon as one is refused."""
    selection = context.selection
    windows, keys = stage.windows, {one.effect.key for one in members}
    added: list[Added] = []
    for one in members:
        if context.watch.stopped:
            return []
        others = _without(stage, members, one, together)
        left = [effect for effect in effects if effect.key == one.effect.key or effect.key not in keys]
        found = survey(others, windows, left, selection.folds)
        p = next((s.p_value for s in found.screened if s.effect.key == one.effect.key), None)
        if p is None:  # the others do all that it does
            return []
        verdict = judged_in(found, one.effect, p, together, numerics, selection, selection.alpha)
        if not verdict.admissible:
            return []
        added.append((Stage(others, windows, found.blocks, found.scores, found.screened, (verdict,)), verdict))
    return added


def _fitted(stage: Stage, members: Sequence[Screened]) -> Fit:
    """The round's model with all members, fitted from where screening would start each."""
    current = stage.current
    model = grown(current.simulator, [one.effect for one in members])
    theta = carry_theta(current.simulator, current.theta, model)
    for one in members:
        theta = with_effect_values(model, theta, one.effect, one.start)
    fitted = fit(model, stage.windows, theta, current.projected.weight, current.lin.starts)
    return restart_inactive_effects(fitted, stage.windows)


def _without(stage: Stage, members: Sequence[Screened], left_out: Screened, together: Fit) -> Fit:
    """The model with all members but one, fitted from where they are together."""
    model = grown(stage.current.simulator, [one.effect for one in members if one is not left_out])
    theta = carry_theta(together.simulator, together.theta, model)
    return fit(model, stage.windows, theta, together.projected.weight, together.lin.starts)
