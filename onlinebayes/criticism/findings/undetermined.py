"""What was added and may be nothing is taken out again: the 90 % interval of its size holds "no effect".

    while some a in h with   q05(a) <= neutral(a) <= q95(a):      h <- h - a,   the a that lies nearest to nothing first

The rule lets an effect in by what it predicts; beside what came later, or over longer windows, its size may be lost
again. An interval that is wide only because the data leave a direction flat says nothing of the effect: it goes where
the rule would not let it in any more.
"""

from __future__ import annotations

from dataclasses import replace

from onlinebayes.criticism.findings.contradicted import rivals_without
from onlinebayes.criticism.hypotheses.additions import AddedEffect
from onlinebayes.criticism.hypotheses.explanation import Explanation
from onlinebayes.criticism.hypotheses.models import fitted_model
from onlinebayes.identification.judging.evaluator import Evaluation, FitRequest, refused


def determined(explanation: Explanation, folds: int | None) -> tuple[Explanation, tuple[str, ...]]:
    """What was found without the effects that may be nothing, and the keys of these.

    Args:
        explanation: what the fit runs say.
        folds: number of blocks of the intervals.
    """
    found, gone = explanation.found, list[str]()
    while (simpler := _without_one(explanation, found, folds)) is not None:
        key, found = simpler
        gone.append(key)
    if not gone:
        return explanation, ()
    return replace(explanation, found=found, rivals=rivals_without(explanation, found, gone)), tuple(gone)


def _without_one(explanation: Explanation, found: Evaluation, folds: int | None) -> tuple[str, Evaluation] | None:
    """The key of the first effect that goes, and the model without it; None where none does."""
    for key, identifiable in _nearest_to_nothing(explanation, found, folds):
        simpler = _fitted_without(explanation, found, key)
        if simpler is not None and (identifiable or refused(found, simpler, explanation.base)):
            return key, simpler
    return None


def _fitted_without(explanation: Explanation, found: Evaluation, key: str) -> Evaluation | None:
    hypothesis = found.hypothesis.minus(key)
    if not hypothesis.additions:
        return explanation.base
    return explanation.evaluator.evaluate(FitRequest(hypothesis, [found.values], found.fitted.lin.starts))


def _nearest_to_nothing(explanation: Explanation, found: Evaluation, folds: int | None) -> list[tuple[str, bool]]:
    """Keys of the effects that may be nothing, the nearest to it first, and whether the data determine each."""
    effects = [one for one in found.hypothesis.additions if isinstance(one, AddedEffect)]
    if not effects:
        return []
    evaluator = explanation.evaluator
    model = fitted_model(found, evaluator, folds, evaluator.discretisation.values, ())
    sizes = [(one.key, *size) for one in effects if (size := one.size(model.parameters)) is not None]
    near = [
        (abs(size.mean - neutral) / max(size.sd, 1e-300), key, size.identifiable)
        for key, size, neutral in sizes
        if size.q05 <= neutral <= size.q95
    ]
    return [(key, identifiable) for _, key, identifiable in sorted(near)]
