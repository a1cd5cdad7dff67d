"""One effect in place of accepted ones that it can be the sum of, and that were found before it.

    air drag                                             ->   wind along x
    air drag, constant load along x                      ->   wind along x
    air drag, constant load along x, constant load on y  ->   wind along x, constant load on y
    constant loads on slides along x and z               ->   gravity tilted towards x

A steady wind is air drag and, to what is slow against it, a constant load; it is tried last, so that these are found
before it. A tilt of slides is a constant load of each of them, and is not tried beside the loads. In the end, where
noise is left, such a law is tried in place of all, of one that it contains with one other and without, or of two loads.
So is one that was found last, in place of all, for what came before may have aped it. It takes their place where it
predicts better with no more parameters, or no worse with fewer; one with more must gain what any effect must. What that
makes needless goes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

from onlinebayes.criticism.candidates.candidates import can_have, grown, propose
from onlinebayes.criticism.candidates.survey import survey
from onlinebayes.criticism.judging.acceptance import LEAST_FALL, Judged, choose, contained
from onlinebayes.criticism.judging.score import CrossValidated, cross_validate, parted, score_gain
from onlinebayes.criticism.searching.backward_elimination import eliminate
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.flexible_candidates import MOST_REFITS_OF_A_GROUP, effect_groups
from onlinebayes.criticism.searching.stage import EVERY_P, Added, judged_stage, leaves_noise, worth
from onlinebayes.criticism.searching.working_model import WorkingModel, carry_theta, with_effects
from onlinebayes.identification.fitting.fit import Fit, fit
from onlinebayes.identification.fitting.numerics import Grounds
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import ConstantLoad, Effect, GravityTilt

MOST_MORE = 1  # parameters that it may have beyond those in whose place it is tried

Account = tuple[Sequence[Added], Sequence[Effect]]
"""What would be left of the accepted effects, and what is tried beside it."""


def put_one_for_several(
    base: Grounds, working: WorkingModel, context: SearchContext, tried: set[str]
) -> WorkingModel | None:
    """The model with one effect in place of several; None without any.

    Args:
        base: the base model, fitted.
        working: a model that leaves noise.
        context: of the search; its watch is looked at between the fits, and the model as it is then stands.
        tried: what was tried on the base model itself before, and did not do.
    """
    for kept, rivals in _accounts(base, working, tried):
        if context.watch.stopped:
            break
        added = _in_place(working, kept, rivals, context)
        if added is not None:
            return eliminate(with_effects(replace(working, accepted=tuple(kept)), [added], context), context)
    return None


def _accounts(base: Grounds, working: WorkingModel, tried: set[str]) -> Iterator[Account]:
    """In place of all, then of fewer."""
    accepted, present = working.accepted, {effect.key for effect in working.effects}
    last = [effect for effect in working.effects if effect.tried_last] if len(accepted) > 1 else []
    containing = _containing(base, present)
    alone = [*last, *(effect for effects in containing.values() for effect in effects)]
    if alone := [effect for effect in alone if effect.key not in tried]:
        yield (), alone
    for simpler, effects in containing.items():
        others = [item for item in accepted if item[1].effect.key not in simpler]
        if len(others) > 1:
            yield from ((kept, effects) for kept in combinations(others, len(others) - 1))
        if others:
            yield others, effects
    loads = [item for item in accepted if isinstance(item[1].effect, ConstantLoad)]
    tilts = propose(base.fitted.simulator, base.windows, [GravityTilt.name]) if len(loads) > 1 else ()
    for pair in combinations(loads, 2):
        yield [item for item in accepted if item not in pair], tilts


def _containing(base: Grounds, present: set[str]) -> dict[frozenset[str], list[Effect]]:
    """Those that are tried last and contain effects that are present, by these."""
    found: dict[frozenset[str], list[Effect]] = {}
    for _, group in effect_groups(base):
        for effect in group:
            if simpler := contained(effect) & present:
                found.setdefault(frozenset(simpler), []).append(effect)
    return found


def _in_place(
    working: WorkingModel, kept: Sequence[Added], rivals: Sequence[Effect], context: SearchContext
) -> Added | None:
    """The best of the rivals beside what is kept, with its judgement; None where none will do."""
    current, selection = working.grounds, context.selection
    windows, step = current.windows, current.windows.bin_step
    model = current.rung.of(grown(working.simulator, [judged.effect for _, judged in kept]))
    most = len(current.fitted.theta) + MOST_MORE
    rivals = [one for one in rivals if can_have(model, one) and len(model.with_effect(one).parameters) <= most]
    if not rivals:
        return None
    context.watch.say(f"looking whether {_names(rivals)} does what others do")
    try:
        without = fit(model, windows, carry_theta(current.fitted.simulator, current.fitted.theta, model))
    except BadInput:  # without them the model diverges
        return None
    screened = survey(without, windows, rivals, selection.folds)
    refits = worth(screened, selection.alpha, EVERY_P)[:MOST_REFITS_OF_A_GROUP]
    # Whether something is missing at all was decided before: screening's p, small or not, says nothing more.
    stage = judged_stage(screened, refits, current.numerics, replace(selection, alpha=1.0), context.watch)
    present = cross_validate(current.fitted, windows, stage.blocks)
    quiet = [one for one in stage.judged if one.admissible and leaves_noise(one.fitted, windows, selection.tolerance)]
    better = [one for one in quiet if _better(one, current.fitted, present, step)]
    return (stage, choose(better, step)) if better else None


def _better(one: Judged, present: Fit, scores: CrossValidated, step: float) -> bool:
    """Whether it predicts better; as well, where it has fewer parameters; as an effect must, where it has more."""
    gain, more = score_gain(one.scores, scores, step), len(one.fitted.theta) - len(present.theta)
    if more > 0:
        return gain.gain > 0 and gain.clear and one.scores.rms_long < (1 - LEAST_FALL) * scores.rms_long
    return gain.gain > 0 if parted(one.scores, scores, step) else more < 0


def _names(effects: Sequence[Effect]) -> str:
    """Of the laws, each once."""
    return " or ".join(dict.fromkeys(effect.name for effect in effects))
