"""One law in place of several accepted ones that it is confounded with: what it does is their sum.

    constant load on the counterweight, gain of the drive   ->   payload in the car

Beside the several, the one moves the replay by nothing that they could not, so that screening gives it no p and no
round tries it again. Its own round may have passed it by as well, where it did not lead. Where noise is left and a
round adds nothing, it is fitted in their place: what has fewer parameters and predicts as well (the rules of
:mod:`.backward_elimination`), and may be added to what is left without them, is the simpler account. Another round
follows, against the model with it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from onlinebayes.criticism.candidates.candidates import grown
from onlinebayes.criticism.candidates.survey import survey
from onlinebayes.criticism.judging.acceptance import Judged, choose
from onlinebayes.criticism.searching.backward_elimination import needed
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.rival_fits import Incumbent
from onlinebayes.criticism.searching.stage import EVERY_P, Added, Stage, judged_in, leaves_noise, refit
from onlinebayes.criticism.searching.working_model import WorkingModel, carry_theta, with_effects
from onlinebayes.identification.fitting.fit import Fit, fit, unfitted
from onlinebayes.identification.replaying.scoped import effect_entries
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Effect

MOST_TRIED = 2  # in place of the same effects, by p
HOPELESS = 2.0  # times the squared error of the model as it stands, which leaves noise


def merge_confounded(working: WorkingModel, last: Stage, context: SearchContext) -> WorkingModel | None:
    """The model with one effect in place of all those it is confounded with; None where none predicts as well.

    Args:
        working: the model; where it leaves more than noise nothing is tried.
        last: the round in which the candidates were screened against it.
        context: of the search; its watch is looked at between the fits, and the model as it is then stands.
    """
    if not working.at_floor(context.selection.tolerance):
        return None
    for kept, rivals in _accounts(working, last):
        if context.watch.stopped:
            break
        added = _in_place(working, kept, rivals, context)
        if added is not None:
            context.watch.say(f"{added[1].effect.key} takes their place")
            return with_effects(replace(working, accepted=tuple(kept)), [added], context)
    return None


def _accounts(working: WorkingModel, last: Stage) -> Iterator[tuple[Sequence[Added], Sequence[Effect]]]:
    """What would be left, and what is confounded with exactly the others, two or more of them."""
    simulator = working.grounds.fitted.simulator
    owner = {name: effect.key for effect in working.effects for name in effect_entries(simulator, effect)}
    rivals: dict[frozenset[str], list[Effect]] = {}
    for screened in last.screened:
        keys = frozenset(owner.get(name, "") for name in screened.confounded_with)
        if len(keys) > 1 and "" not in keys:
            rivals.setdefault(keys, []).append(screened.effect)
    for keys, effects in rivals.items():
        yield [item for item in working.accepted if item[1].effect.key not in keys], effects


def _in_place(
    working: WorkingModel, kept: Sequence[Added], rivals: Sequence[Effect], context: SearchContext
) -> Added | None:
    """The best of the rivals beside what is kept, with its judgement; None where none will do."""
    current, selection = working.grounds, context.selection
    windows = current.windows
    model = current.rung.of(grown(working.simulator, [judged.effect for _, judged in kept]))
    theta = carry_theta(current.fitted.simulator, current.fitted.theta, model)
    incumbent = Incumbent.on(current, selection.folds)
    try:
        # The other parameters begin where they are: there the one does what the several did.
        begun = unfitted(model, windows, theta, current.fitted.projected.weight, current.fitted.lin.starts)
        fits = _fits(begun, rivals, incumbent, context)
        if not fits:
            return None
        without = fit(model, windows, theta, current.fitted.projected.weight, current.fitted.lin.starts)
    except BadInput:  # without them the model diverges
        return None
    if context.watch.stopped:  # the last fit may have been cut short
        return None
    found = survey(without, windows, list(fits), selection.folds)
    judged: list[Judged] = []
    for screened in found.screened:
        fitted, p = fits[screened.effect], screened.p_value or 0.0
        judged.append(judged_in(found, screened.effect, p, fitted, current.numerics, selection, EVERY_P))
    stage = Stage(without, windows, found.blocks, found.scores, found.screened, tuple(judged))
    admissible = [one for one in judged if one.admissible]
    return (stage, choose(admissible, windows.bin_step)) if admissible else None


def _fits(begun: Fit, rivals: Sequence[Effect], incumbent: Incumbent, context: SearchContext) -> dict[Effect, Fit]:
    """The rivals' fits that have fewer parameters than the incumbent, leave noise and predict as well."""
    current, windows, selection = incumbent.grounds, incumbent.grounds.windows, context.selection
    most = HOPELESS * current.fitted.projected.objective
    fewer = [one for one in rivals if len(begun.simulator.with_effect(one).parameters) < len(current.fitted.theta)]
    found: dict[Effect, Fit] = {}
    for screened in survey(begun, windows, fewer, selection.folds).screened[:MOST_TRIED] if fewer else ():
        if screened.p_value is None or context.watch.stopped:
            continue
        context.watch.say(f"looking whether {screened.effect.key} explains what several effects do")
        try:
            fitted, effect = refit(begun, windows, screened.effect, screened.start, most, screened.others)
        except BadInput:
            continue
        if not leaves_noise(fitted, windows, selection.tolerance):
            continue
        if not needed(incumbent.scores, incumbent.validated(fitted), windows.bin_step):
            found[effect] = fitted
    return found
