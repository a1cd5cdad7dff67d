"""The evidence for each name that is said: how much it gains, how surely, beside what else, and what is still left.

A name and its equals are one statement: one of them is in the machine. The weights say how it is shared among them,
those of the final model and its fitted rivals; an equal that was not fitted weighs as much as what it equals.

    p(one of them) = 1 / (1 + e^-(b . x)),      p(a name) = its weight p(one of them)

within 1 / (N + 2) of 0 and 1, N the number of statements that b was learnt on (Laplace's rule of succession). Each x is
cut to the range that it was learnt over: a real machine leaves a thousand times its noise, and no blind case does.

The coefficients b are learnt on blind cases, see ``learnt.json`` beside this file: it names the command that made it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from onlinebayes.criticism.hypotheses.additions import AddedEffect, WiderBounds
from onlinebayes.criticism.hypotheses.explanation import Explanation
from onlinebayes.criticism.hypotheses.ranking import equals, laws
from onlinebayes.criticism.hypotheses.weighing import weighted
from onlinebayes.criticism.results import Candidate
from onlinebayes.identification.judging.hypothesis import Addition
from onlinebayes.identification.results import Estimate
from onlinebayes.runs import BadInput

LEARNT = Path(__file__).with_name("learnt.json")


FARTHEST = 30.0
"""Standard deviations from nothing, beyond which more of them say no more."""


@dataclass(frozen=True)
class Named:
    """One name that was said, and what speaks for it.

    Args:
        name: key of what was added.
        equals: keys of what cannot be told from it.
        weights: of the name and of its equals, in their order; they add up to 1.
        gain, se: of left-out score, data left out by runs, and its standard error [nats].
        least: the least gain over all ways of leaving data out [nats].
        place: 0 for what was added first.
        left: what the final model leaves of the worst signal [floors].
        away: how far its size lies from nothing, in its own standard deviations; :data:`FARTHEST` at most, and of what
            has no such size.
    """

    name: str
    equals: tuple[str, ...]
    weights: tuple[float, ...]
    gain: float
    se: float
    least: float
    place: int
    left: float
    away: float = FARTHEST


def evidence(said: Named) -> tuple[float, ...]:
    """x: a constant, what is left, how certain and large the gain, how many equals, how late, how far from nothing."""
    left = math.log(min(max(said.left, 1.0), 100.0))
    certain = math.log(min(max(said.gain / max(said.se, 1e-9), 1.0), 300.0)) / 3
    large = math.log(min(max(said.least, 0.01), 10.0)) / 3
    away = math.log(min(max(said.away, 0.3), FARTHEST)) / 3
    return 1.0, left, certain, large, math.log1p(len(said.equals)), float(min(said.place, 2)), away


@dataclass(frozen=True)
class Learnt:
    """What was learnt on blind cases.

    Args:
        coefficients: b.
        statements: number of statements that they were learnt on.
        low, high: of each x among these.
    """

    coefficients: tuple[float, ...]
    statements: int
    low: tuple[float, ...]
    high: tuple[float, ...]

    def log_odds(self, x: Sequence[float]) -> float:
        """b . x, x cut to what was seen."""
        seen = (min(max(value, low), high) for value, low, high in zip(x, self.low, self.high, strict=True))
        return sum(b * value for b, value in zip(self.coefficients, seen, strict=True))


@cache
def learnt() -> Learnt:
    """What the file beside this one holds.

    Raises:
        BadInput: it is missing.
    """
    if not LEARNT.exists():
        raise BadInput(f"{LEARNT.name} is missing", "run python -m recipes.studies.reliability --learn")
    told = json.loads(LEARNT.read_text(encoding="utf-8"))
    return Learnt(tuple(told["coefficients"]), told["statements"], tuple(told["low"]), tuple(told["high"]))


def probability(said: Named) -> float:
    """Compute the probability that a name or one of its equals is in the machine.

    N statements that were all right, or all wrong, would say (N + 1) / (N + 2) or 1 / (N + 2): nothing more certain.
    """
    known = learnt()
    p = 1 / (1 + math.exp(-known.log_odds(evidence(said))))
    least = 1 / (known.statements + 2)
    return min(max(p, least), 1 - least)


def with_probabilities(candidates: Iterable[Candidate], named: Iterable[Named]) -> tuple[Candidate, ...]:
    """Candidates with the probability of each that was said, or is equal to what was said."""
    known: dict[str, float] = {}
    for said in named:
        p = probability(said)
        for name, weight in zip((said.name, *said.equals), said.weights, strict=True):
            known.setdefault(name, p * weight)
    return tuple(replace(row, probability=known.get(row.effect)) for row in candidates)


def names_said(explanation: Explanation, left: float, parameters: Mapping[str, Estimate]) -> tuple[Named, ...]:
    """Every name of an answer, in the order in which they were added; a bound that is wider names nothing.

    Args:
        explanation: what was found.
        left: what the final model leaves of the worst signal [floors].
        parameters: of the final model, by name.
    """
    kept = laws(explanation.found.hypothesis)
    rounds = {one.added.addition.key: one for one in explanation.rounds if one.added is not None}
    found = []
    for place, name in enumerate(name for name in kept if name in rounds):
        added = rounds[name].added
        assert added is not None
        if isinstance(added.addition, WiderBounds):
            continue
        others = equals(rounds[name])
        weights = _weights(explanation, name, others)
        first = added.gains[0]
        found.append(
            Named(
                name, others, weights, first.gain, first.se, added.least, place, left, _away(added.addition, parameters)
            )
        )
    return tuple(found)


def _away(addition: Addition, parameters: Mapping[str, Estimate]) -> float:
    """How far the size of an effect lies from nothing [standard deviations]."""
    found = addition.size(parameters) if isinstance(addition, AddedEffect) else None
    if found is None or found[0].sd <= 0:
        return FARTHEST
    size, neutral = found
    return min(abs(size.mean - neutral) / size.sd, FARTHEST)


def _weights(explanation: Explanation, name: str, others: tuple[str, ...]) -> tuple[float, ...]:
    own, *rivals = weighted(explanation)
    fitted: dict[str, float] = {}
    for one in rivals:
        for key in laws(one.evaluation.hypothesis):
            fitted[key] = fitted.get(key, 0.0) + one.weight
    each = [own.weight, *(fitted.get(key, own.weight) for key in others)]
    total = sum(each) or 1.0
    return tuple(weight / total for weight in each)
