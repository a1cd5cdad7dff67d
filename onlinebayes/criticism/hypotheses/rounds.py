"""A round of the search: what was screened, what was refitted, what entered; a step that follows from it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from onlinebayes.criticism.hypotheses.additions import AddedEffect, WiderBounds
from onlinebayes.criticism.hypotheses.screening import Prediction
from onlinebayes.identification.judging.evaluator import Evaluation
from onlinebayes.identification.judging.hypothesis import Addition
from onlinebayes.identification.judging.rule import equally_good
from onlinebayes.identification.judging.scoring import Gain


@dataclass(frozen=True, eq=False)
class Trial:
    """An addition, refitted: what it gains over the hypothesis of its round, and why it was refused."""

    addition: Addition
    evaluation: Evaluation
    gains: tuple[Gain, ...]
    refused: str | None

    @property
    def least(self) -> float:
        """The least gain, over all ways of leaving data out [nats]."""
        return min(one.gain for one in self.gains)


@dataclass(frozen=True, eq=False)
class Round:
    """One round of the search.

    Args:
        begun: from where it went.
        screened: what screening promised, the best first.
        tried: what was refitted.
        added: what the rule preferred, None in the last round.
        equal: what was refitted and is equally good.
        alike: the same law as what was added, to first order, and was not refitted.
        silent: keys of the candidates that move no measured signal.
    """

    begun: Evaluation
    screened: tuple[Prediction, ...]
    tried: tuple[Trial, ...]
    added: Trial | None = None
    equal: tuple[Trial, ...] = ()
    alike: tuple[Addition, ...] = ()
    silent: tuple[str, ...] = ()

    @property
    def equals(self) -> tuple[Addition, ...]:
        """The additions that cannot be told from what was added."""
        return (*(trial.addition for trial in self.equal), *self.alike)


def without_unused_bounds(found: Round) -> Round:
    """With wider bounds for those parameters alone that lie outside the old ones, once they are fitted."""
    tried, screened = list(found.tried), list(found.screened)
    for k, trial in enumerate(tried):
        if not isinstance(trial.addition, WiderBounds):
            continue
        needed = trial.addition.used(trial.evaluation.values)
        hypothesis = found.begun.hypothesis.plus(needed)
        tried[k] = replace(trial, addition=needed, evaluation=replace(trial.evaluation, hypothesis=hypothesis))
        screened = [replace(one, addition=needed) if one.addition == trial.addition else one for one in screened]
    return replace(found, tried=tuple(tried), screened=tuple(screened))


@dataclass(frozen=True, eq=False)
class Move:
    """A step of the search.

    Args:
        found: where it leads.
        rounds: what led there; none of a better fit of the same hypothesis.
        together: whether its additions are only better together, so that none of them is dropped.
    """

    found: Evaluation
    rounds: tuple[Round, ...] = ()
    together: bool = False

    @classmethod
    def to(cls, rounds: Sequence[Round]) -> Move:
        """To what the last of some rounds added."""
        added = rounds[-1].added
        assert added is not None
        return cls(added.evaluation, tuple(rounds))


def simplest_of_equals(found: Sequence[Evaluation], here: Evaluation) -> Evaluation:
    """The one that gains most over ``here``, or one that is equally good with fewer parameters."""
    best = min(found, key=lambda one: one.fitted.score)
    won = [one.gain for one in best.gains(here)]
    equal = [one for one in found if one is best or equally_good(best.gains(one), won)]
    return min(equal, key=lambda one: len(one.fitted.theta))


def at_end(addition: Addition, evaluation: Evaluation) -> bool:
    """Check whether an effect has the largest size that can be."""
    return isinstance(addition, AddedEffect) and addition.at_end(evaluation.values)


def so_far(base: Evaluation, here: Evaluation) -> str:
    """A first answer, before the search has ended."""
    before, after = (float(one.left_out[0].squares.sum()) for one in (base, here))
    names = " + ".join(here.hypothesis.keys) or "nothing"
    left = 100 * math.sqrt(after / max(before, 1e-300))
    return f"so far: {names}; {left:.2g} % of the error is left; the search goes on."
