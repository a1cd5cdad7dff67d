"""What was added and may be nothing is taken out again: the 90 % interval of its size holds "no effect".

    while some a in h with   q05(a) <= neutral(a) <= q95(a):      h <- h - a,   the a that lies nearest to nothing first

The rule lets an effect in by what it predicts; beside what came later, or over longer windows, its size may be lost
again. An interval that is wide only because the data leave a direction flat says nothing of the effect: it goes where
the rule would not let it in any more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from onlinebayes.criticism.findings.contradicted import rivals_without
from onlinebayes.criticism.hypotheses.additions import AddedEffect
from onlinebayes.criticism.hypotheses.explanation import Explanation
from onlinebayes.criticism.hypotheses.models import fitted_model
from onlinebayes.identification.judging.evaluator import Evaluation, FitRequest, refused
from onlinebayes.identification.results import Estimate


def determined(explanation: Explanation, folds: int | None) -> tuple[Explanation, tuple[str, ...]]:
    """What was found without the effects that may be nothing, and the keys of these.

    Args:
        explanation: what the fit runs say.
        folds: number of blocks of the intervals.
    """
    found, gone, evaluator = explanation.found, list[str](), explanation.evaluator
    while (nothing := _nearest_to_nothing(explanation, found, folds)) is not None:
        key, known = nothing
        hypothesis = found.hypothesis.minus(key)
        simpler: Evaluation | None = explanation.base
        if hypothesis.additions:
            simpler = evaluator.evaluate(FitRequest(hypothesis, [found.values], found.fitted.lin.starts))
        if simpler is None or not (known or refused(found, simpler, explanation.base)):
            break
        found = simpler
        gone.append(key)
    if not gone:
        return explanation, ()
    return replace(explanation, found=found, rivals=rivals_without(explanation, found, gone)), tuple(gone)


def _nearest_to_nothing(explanation: Explanation, found: Evaluation, folds: int | None) -> tuple[str, bool] | None:
    """Key of the effect that lies nearest to nothing, of those that may be, and whether its interval is its own."""
    effects = [one for one in found.hypothesis.additions if isinstance(one, AddedEffect) and not one.per_run]
    if not effects or found is explanation.base:
        return None
    evaluator = explanation.evaluator
    model = fitted_model(found, evaluator, folds, evaluator.discretisation.values, ())
    near = [
        (abs(size.mean - neutral) / max(size.sd, 1e-300), one.key, size.identifiable)
        for one in effects
        for size, neutral in _size(one, model.parameters)
        if size.q05 <= neutral <= size.q95
    ]
    return min(near)[1:] if near else None


def _size(addition: AddedEffect, parameters: Mapping[str, Estimate]) -> list[tuple[Estimate, float]]:
    """Its size, and the one at which it is nothing; none where each run has one of its own."""
    effect = addition.effect
    size = parameters.get(f"{effect.key}.{effect.magnitude}")
    return [] if size is None else [(size, effect.neutral[effect.magnitude])]
