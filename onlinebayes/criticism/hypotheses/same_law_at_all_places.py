"""One law at every place that can have it.

    h <- h + law@a + law@b + ...      if the rule prefers them together to the best single addition

The joints of a machine are built alike. Where all of them lack the same, one alone explains little, and something else,
such as a mass far from its value, may explain more: that law enters at all places at once. The search drops the places
that its rule does not ask for.
"""

from __future__ import annotations

from collections.abc import Iterator

from onlinebayes.criticism.hypotheses.additions import AddedEffect, FreedNumber
from onlinebayes.criticism.hypotheses.rounds import Round
from onlinebayes.identification.judging.evaluator import Evaluation, Evaluator, FitRequest
from onlinebayes.identification.judging.hypothesis import Addition, Hypothesis
from onlinebayes.identification.judging.rule import preferred


def law_of(addition: Addition) -> str | None:
    """Return the law without its place: ``viscous_friction``, ``joint.damping``; None of what has one size a run."""
    if isinstance(addition, AddedEffect):
        return None if addition.per_run else addition.effect.name
    if isinstance(addition, FreedNumber):
        kind, _, rest = addition.address.partition(".")
        return f"{kind}.{rest.rpartition('.')[2]}"
    return None


def at_every_place(evaluator: Evaluator, here: Evaluation, alone: Round, room: int) -> Iterator[Evaluation]:
    """Each law that is preferred at all its places to the best single addition, the most promising one first.

    Args:
        evaluator: fits.
        here: to which they are added.
        alone: what each addition does by itself.
        room: most places.
    """
    if not alone.tried:
        return
    best = min((trial.evaluation for trial in alone.tried), key=lambda one: one.fitted.score)
    begun = {prediction.addition: prediction.begun for prediction in alone.screened}
    for law in dict.fromkeys(filter(None, (law_of(trial.addition) for trial in alone.tried))):
        places = [addition for addition in begun if law_of(addition) == law]
        if not 1 < len(places) <= room:
            continue
        hypothesis = Hypothesis((*here.hypothesis.additions, *places))
        both = [{name: x for place in places for name, x in begun[place][k].items()} for k in (0, -1)]
        found = evaluator.evaluate(FitRequest(hypothesis, both, here.fitted.lin.starts, (here.values, {})))
        if found is not None and preferred(found.gains(best), best.gains(here)[0]):
            yield found
