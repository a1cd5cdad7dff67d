"""One law at every place that can have it, where all of them together leave no more than noise.

    h <- h + law@a + law@b + ...      if no single addition leaves noise, these do, and the rule prefers each of them

The joints of a machine are built alike. Where all of them lack the same, one alone explains little, and something else,
such as a mass far from its value, may explain more: that law enters at all places at once. The search drops the places
that its rule does not ask for.
"""

from __future__ import annotations

from collections.abc import Iterator

from onlinebayes.criticism.hypotheses.additions import AddedEffect, FreedNumber
from onlinebayes.criticism.hypotheses.original_integrator import with_original_integrator
from onlinebayes.criticism.hypotheses.rounds import Round
from onlinebayes.identification.judging.evaluator import Evaluation, Evaluator, FitRequest, at_noise_floor
from onlinebayes.identification.judging.hypothesis import Addition, Hypothesis
from onlinebayes.identification.judging.rule import explains_half


def law_of(addition: Addition) -> str | None:
    """Return the law without its place: ``viscous_friction``, ``joint.damping``; None of what has one size a run."""
    if isinstance(addition, AddedEffect):
        return None if addition.per_run else addition.effect.name
    if isinstance(addition, FreedNumber):
        kind, _, rest = addition.address.partition(".")
        return f"{kind}.{rest.rpartition('.')[2]}"
    return None


def at_every_place(evaluator: Evaluator, here: Evaluation, alone: Round, room: int) -> Iterator[Evaluation]:
    """Each law that leaves noise at all its places, in the order of what the laws promise at one place.

    Args:
        evaluator: fits.
        here: to which they are added.
        alone: what each addition does by itself.
        room: most places.
    """
    begun = {prediction.addition: prediction.begun for prediction in alone.screened}
    for law in dict.fromkeys(filter(None, (law_of(trial.addition) for trial in alone.tried))):
        places = [addition for addition in begun if law_of(addition) == law]
        if not 1 < len(places) <= room:
            continue
        hypothesis = Hypothesis((*here.hypothesis.additions, *places))
        both = [{name: x for place in places for name, x in begun[place][k].items()} for k in (0, -1)]
        found = evaluator.evaluate(FitRequest(hypothesis, both, here.fitted.lin.starts, (here.values, {})))
        if found is not None and _leaves_noise(evaluator, found, alone):
            yield found


def _leaves_noise(evaluator: Evaluator, found: Evaluation, alone: Round) -> bool:
    """Check whether no more than noise is left in the steps that it asks for; no such step is tried in vain."""
    best = min((trial.evaluation for trial in alone.tried), key=lambda one: one.fitted.score)
    if at_noise_floor(found) or not explains_half(best.left_out[0], found.left_out[0]):
        return at_noise_floor(found)
    finer = evaluator.refined(found)
    again = found if finer is evaluator else finer.anew(found)
    if again is None or at_noise_floor(again):
        return again is not None
    other = with_original_integrator(finer, again)
    return other is not None and at_noise_floor(other[1])
