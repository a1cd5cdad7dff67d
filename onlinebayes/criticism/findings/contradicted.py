"""The removal of additions that make the held-out runs worse, from the model as from the report.

    while some a in h:   S_held(h - a) <= S_held(h)      h <- the h - a of the least S_held

S_held is the score of the held-out windows, as long as those of the reported error, each from its best start
(:mod:`..judging.held_out`), in nats. An addition may fit what it was fitted to for a wrong reason; on runs that it has
not seen it costs more than it brings then. What stays gains S_held(base) - S_held(h).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from onlinebayes.criticism.hypotheses.additions import OwnValues
from onlinebayes.criticism.hypotheses.explanation import Explanation
from onlinebayes.identification.judging.evaluator import Evaluation, Evaluator, FitRequest
from onlinebayes.identification.judging.held_out import held_out_errors
from onlinebayes.identification.judging.hypothesis import Hypothesis
from onlinebayes.measurements import Measurement
from onlinebayes.runs import side_by_side


@dataclass(frozen=True, eq=False)
class Uncontradicted:
    """What the held-out runs leave of an explanation.

    Args:
        explanation: without what they contradict.
        gone: keys of that.
        gain: of what stays, over the base model [nats]; not a number where nothing stays or nothing is known.
    """

    explanation: Explanation
    gone: tuple[str, ...] = ()
    gain: float = math.nan


def uncontradicted(explanation: Explanation, held: Measurement, horizon: float) -> Uncontradicted:
    """Remove the additions that the held-out runs contradict from what was found.

    Args:
        explanation: what the fit runs say.
        held: the held-out runs.
        horizon: length of the windows over which their error is reported [s].
    """
    base, found, evaluator, gone = explanation.base, explanation.found, explanation.evaluator, list[str]()
    if found is base:
        return Uncontradicted(explanation)
    of_base, score = side_by_side([partial(_score, evaluator, one, held, horizon) for one in (base, found)])
    while keys := [one.key for one in found.hypothesis.additions if not isinstance(one, OwnValues)]:
        simpler: list[tuple[Evaluation | None, float]] = [(base, of_base)]
        if len(found.hypothesis.additions) > 1:
            simpler = side_by_side([partial(_without, explanation, found, key, held, horizon) for key in keys])
        key, best, least = min(
            ((key, one, s) for key, (one, s) in zip(keys, simpler, strict=True)), key=lambda other: other[2]
        )
        if best is None or least > score or math.isinf(least):
            break
        found, score = best, least
        gone.append(key)
    if gone:
        explanation = replace(explanation, found=found, rivals=rivals_without(explanation, found, gone))
    return Uncontradicted(explanation, tuple(gone), math.nan if found is base else of_base - score)


def rivals_without(explanation: Explanation, found: Evaluation, gone: Sequence[str]) -> tuple[Evaluation, ...]:
    """The rivals without what was taken out; none where that is what they are rivals of."""
    if explanation.found.hypothesis.keys[:1] != found.hypothesis.keys[:1]:
        return ()
    simpler = []
    for rival in explanation.rivals:
        hypothesis = Hypothesis(tuple(one for one in rival.hypothesis.additions if one.key not in gone))
        if one := explanation.evaluator.evaluate(FitRequest(hypothesis, [rival.values], rival.fitted.lin.starts)):
            simpler.append(one)
    return tuple(simpler)


def _without(
    explanation: Explanation, found: Evaluation, key: str, held: Measurement, horizon: float
) -> tuple[Evaluation | None, float]:
    """The hypothesis without one of its additions, and its score over the held-out runs; infinite without a fit."""
    request = FitRequest(found.hypothesis.minus(key), [found.values], found.fitted.lin.starts)
    simpler = explanation.evaluator.evaluate(request)
    return simpler, math.inf if simpler is None else _score(explanation.evaluator, simpler, held, horizon)


def _score(evaluator: Evaluator, evaluation: Evaluation, held: Measurement, horizon: float) -> float:
    """Sum over signals of 1/2 log(error^2 + 1), errors of the held-out runs in floors."""
    names = [evaluator.given.signals[column] for column in evaluator.windows.columns]
    floors = dict(zip(names, evaluator.windows.noise.tolist(), strict=True))
    errors = held_out_errors(evaluator, evaluation, held, horizon)
    return sum(0.5 * math.log1p((error / floors[name]) ** 2) for name, error in errors.items() if not math.isnan(error))
