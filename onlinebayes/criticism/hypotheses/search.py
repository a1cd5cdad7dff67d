"""The search: from hypothesis to hypothesis by moves, as long as the rule prefers a neighbour.

    while some h' in moves(h) is preferred to h:    h <- the first of them
    moves(h) = h fitted better, one law at every place, h + a candidate, h + a flexible candidate, h + two candidates

each followed by h without those of its additions that are not preferred any more.

Screening proposes (:mod:`.screening`), a refit evaluates (:mod:`.judging.evaluator`), the rule decides
(:mod:`.judging.rule`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial

from onlinebayes.criticism.hypotheses.additions import WiderBounds, wider_bounds
from onlinebayes.criticism.hypotheses.original_integrator import with_original_integrator
from onlinebayes.criticism.hypotheses.rounds import (
    Move,
    Round,
    Trial,
    at_end,
    simplest_of_equals,
    so_far,
    without_unused_bounds,
)
from onlinebayes.criticism.hypotheses.same_law_at_all_places import at_every_place
from onlinebayes.criticism.hypotheses.screening import Prediction, screen
from onlinebayes.identification.judging.evaluator import (
    Evaluation,
    Evaluator,
    FitRequest,
    at_noise_floor,
    better,
    refused,
)
from onlinebayes.identification.judging.hypothesis import Addition, Hypothesis
from onlinebayes.identification.judging.rule import LEAST_GAIN, SHARE_OF_GAINED, equally_good
from onlinebayes.runs import side_by_side

REFITS = 3
"""Candidates that are refitted in a round: screening's median error is below a tenth of a nat."""

LEAST_PREDICTED_GAIN = LEAST_GAIN / 5
"""Candidates that promise less are not refitted: nine predictions of ten are nearer to the truth than that."""

RIVALS_MARGIN = 3 * SHARE_OF_GAINED
"""Of the best gain of a round, by which another addition may be behind and is still fitted to its end."""

PAIRED = 3
"""Candidates beside which a second one is looked for, where none is preferred alone."""

MOST_ADDITIONS = 6
"""A model that needs more has another fault."""


@dataclass
class Search:
    """A search from the base model on.

    Args:
        evaluator: fits and judges; replaced by a finer one where what was added asks for it.
        base: the base model as it evaluated it.
        candidates: the additions to try.
        last: those with so much freedom that they are tried where none of the others is preferred to the base model,
            and believed where they leave no more than noise.
        most: additions at which the search ends.
        rounds: so far.

    Attributes:
        current: the preferred hypothesis so far: what stands where the search is stopped.
        pending: the round that found it, where that is not one of ``rounds`` yet.
    """

    evaluator: Evaluator
    base: Evaluation
    candidates: Sequence[Addition]
    last: Sequence[Addition] = ()
    most: int = MOST_ADDITIONS
    rounds: list[Round] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.current, self.flexible = self.base, set[Addition]()
        self.pending: tuple[Round, ...] = ()
        self._best = {frozenset(self.base.hypothesis.keys): self.base}
        self._left = set[frozenset[str]]()

    def run(self) -> Evaluation:
        """The hypothesis of which no neighbour is preferred."""
        self.current = self.base = self.refined(self.base)
        self.flexible = {*self.last}
        while (move := next(self.moves(here := self.current), None)) is not None:
            if not move.rounds:
                self.base = move.found if here is self.base else self.base
                self.current = move.found
                continue
            self._left.add(frozenset(here.hypothesis.keys))
            self.rounds += move.rounds
            self.pending = ()
            after = self.refined(move.found)
            self.current = after if move.together else self.pruned(after)
            self.evaluator.watch(so_far(self.base, self.current))
        return self.current

    def moves(self, here: Evaluation) -> Iterator[Move]:
        """The preferred neighbours of a hypothesis, in the order in which they are tried; the first one is taken.

        What was dropped may be preferred again beside what came later: a hypothesis that the search has left ends it.
        """
        keys = here.hypothesis.keys
        if len(keys) >= self.most or frozenset(keys) in self._left:
            return
        self._kept(here.hypothesis, here)
        alone = self.round(here)
        if alone.added is not None:
            self.current, self.pending = alone.added.evaluation, (alone,)
            # Perhaps it was not the addition that was missing, but a better fit without it.
            again = self.evaluated_from(alone.added.evaluation, here.hypothesis)
            if again is not here:
                self.pending = ()
                yield Move(again)
        if alike := self.at_all_places(here, alone):
            yield Move.to(alike)
        if alone.added is not None:
            yield Move.to([alone])
        rounds = [alone]
        if here is self.base and not at_noise_floor(here):
            if self.last:
                self.last, free = (), self.round(here, self.last)
                rounds.append(free)
                if free.added is not None:
                    yield Move.to(rounds)
            if pair := self.pair(here, rounds[-1]):
                yield replace(Move.to([*rounds[:-1], *pair]), together=True)
        self.rounds += rounds

    def at_all_places(self, here: Evaluation, alone: Round) -> list[Round]:
        """One law at all its places, as a round for each, see :mod:`.same_law_at_all_places`; none without."""
        if at_noise_floor(here) or (alone.added is not None and at_noise_floor(alone.added.evaluation)):
            return []
        found = list(at_every_place(self.evaluator, here, alone, self.most - len(here.hypothesis.keys)))
        if not found:
            return []
        stood = self.current, self.pending
        # Where the search is stopped now, it stands, and what was tried is told.
        self.current, self.pending = simplest_of_equals(found, here), (replace(alone, added=None),)
        best = self.pruned(self.current, entered=0)
        new = len(best.hypothesis.keys) - len(here.hypothesis.keys)
        if new > 1 and refused(best, here, self.base) is None:
            return self.one_by_one(here, best, alone)
        self.current, self.pending = stood
        return []

    def one_by_one(self, here: Evaluation, best: Evaluation, alone: Round) -> list[Round]:
        """The additions of ``best`` that ``here`` lacks, as a round for each."""
        rounds, before = list[Round](), here
        for addition in (one for one in best.hypothesis.additions if one not in here.hypothesis.additions):
            after = self.evaluated_from(best, before.hypothesis.plus(addition))
            trial = Trial(addition, after, after.gains(before), None)
            tried = tuple(one for one in alone.tried if one.addition != addition)
            rounds.append(replace(alone, begun=before, added=trial, alike=_alike(alone.screened, tried, trial)))
            before = after
        return rounds

    def pair(self, here: Evaluation, alone: Round) -> tuple[Round, Round] | None:
        """Two additions at once where each hides the other: the pair that gains most, as two rounds; None without."""
        enough = list(self.pairs(here, alone)) if self.most > 1 else []
        if not enough:
            return None
        best = max((both for _, both, _ in enough), key=lambda both: both.least)
        equal = [one for one in enough if one[1] is best or _equal(best, one[1])]
        first, both, beside = min(equal, key=lambda one: (_parameters(one[1])[0], one[0].addition.rank, -one[1].least))
        second = next(trial for trial in beside.tried if trial.addition == both.addition)
        firsts = tuple({one.addition: one for one, _, _ in equal if one is not first}.values())
        seconds = tuple(one for _, one, of in equal if of is beside and one is not both)
        return replace(alone, added=first, equal=firsts), replace(beside, added=second, equal=seconds)

    def pairs(self, here: Evaluation, alone: Round) -> Iterator[tuple[Trial, Trial, Round]]:
        """Every pair that is preferred: the first addition, both with what they gain, and the round beside the first.

        A flexible law may be the first one, too, where both together leave noise.
        """
        by_gain = sorted(alone.tried, key=lambda trial: -trial.least)
        free = [trial for trial in by_gain if trial.addition in self.flexible][:1]
        firsts = (*[trial for trial in by_gain if trial.addition not in self.flexible][:PAIRED], *free)
        found = side_by_side([partial(self._twin().tried_all, first.evaluation) for first in firsts])
        for first, beside in zip(firsts, found, strict=True):
            for second in beside.tried:
                both = replace(second, gains=second.evaluation.gains(here))
                believed = first not in free or at_noise_floor(both.evaluation)
                believed &= not any(at_end(one.addition, both.evaluation) for one in (first, second))
                if believed and refused(both.evaluation, here, self.base) is None:
                    yield first, both, beside

    def _twin(self) -> Search:
        """A search that stands where this one does, and remembers its fits for itself."""
        twin = copy(self)
        twin._best = dict(self._best)
        return twin

    def evaluated_from(self, richer: Evaluation, hypothesis: Hypothesis) -> Evaluation:
        """A simpler hypothesis, fitted from where a richer one ended too; the richer one where it cannot be."""
        request = FitRequest(hypothesis, [richer.values], richer.fitted.lin.starts)
        return self._kept(hypothesis, self.evaluator.evaluate(request)) or richer

    def _kept(self, hypothesis: Hypothesis, found: Evaluation | None) -> Evaluation | None:
        """The best fit of a hypothesis in this search so far."""
        key = frozenset(hypothesis.keys)
        best = better(found, self._best.get(key))
        if best is not None:
            self._best[key] = best
        return best

    def round(self, here: Evaluation, more: Sequence[Addition] = ()) -> Round:
        """Screen all candidates and some more, refit those that promise most, add what the rule prefers."""
        found = self.tried_all(here, more)
        tried = found.tried
        best = max((trial for trial in tried if trial.refused is None), key=lambda trial: trial.least, default=None)
        if best is None:
            return found
        equal = [trial for trial in tried if trial is best or _equal(best, trial)]
        chosen = min((trial for trial in equal if trial.refused is None), key=_parameters)
        others = tuple(trial for trial in equal if trial is not chosen)
        return replace(found, added=chosen, equal=others, alike=_alike(found.screened, tried, chosen))

    def tried_all(self, here: Evaluation, more: Sequence[Addition] = ()) -> Round:
        """All candidates screened, those that promise most refitted; nothing added yet."""
        evaluator = self.evaluator
        evaluator.watch(f"screening with {here.hypothesis}")
        present = set(here.hypothesis.keys)
        # A number on the end of its range is no answer: the range is widened until the fit stands inside.
        wider = wider_bounds(here.fitted.simulator, here.values)
        left = [addition for addition in (*wider, *self.candidates, *more) if addition.key not in present]
        screened = tuple(screen(evaluator, here, left))
        shown = {prediction.addition.key for prediction in screened}
        silent = tuple(addition.key for addition in left if addition.key not in shown)
        asked = promising(screened)
        if asked and here is self.base:
            evaluator.watch(f"so far: {asked[0].addition.key} promises most, from one replay; it is not fitted yet.")
        tried = self.tried(here, asked[:1], math.inf)
        # What the first one gains is what the others have to come near to.
        tried += self.tried(here, asked[1:], _wanted(here, tried))
        return without_unused_bounds(Round(here, screened, tuple(tried), silent=silent))

    def tried(self, here: Evaluation, predictions: Sequence[Prediction], wanted: float) -> list[Trial]:
        """Each of some additions, fitted from where screening looked; without those that cannot be followed.

        Args:
            here: to which one of them is added.
            predictions: what screening said of them.
            wanted: the score that they have to come down to; see :func:`.gauss_newton.fit`.
        """
        models: tuple[dict[str, float], ...] = (here.values, self.base.values, {})
        requests = []
        for prediction in predictions:
            begun = [dict(one) for one in dict.fromkeys(tuple(values.items()) for values in prediction.begun)]
            hypothesis = here.hypothesis.plus(prediction.addition)
            requests.append(FitRequest(hypothesis, begun, here.fitted.lin.starts, models, wanted=wanted))
        found = self.evaluator.evaluate_all(requests)
        best = [self._kept(request.hypothesis, one) for request, one in zip(requests, found, strict=True)]
        each = zip(predictions, best, strict=True)
        return [self._trial(here, prediction, one) for prediction, one in each if one is not None]

    def _trial(self, here: Evaluation, prediction: Prediction, evaluation: Evaluation) -> Trial:
        """Judge a fitted addition by the rule."""
        gains = evaluation.gains(here)
        why = refused(evaluation, here, self.base)
        addition = prediction.addition
        if at_end(addition, evaluation):
            why = why or "has the largest size that can be: no size of it explains the data"
        if addition in self.flexible and not at_noise_floor(evaluation):
            why = why or "has too much freedom to be believed where it leaves more than noise"
        return Trial(addition, evaluation, gains, why)

    def refined(self, here: Evaluation) -> Evaluation:
        """The same hypothesis, integrated as it asks: as finely, or as a simulator would; the base model too."""
        evaluator = self.evaluator.refined(here)
        if evaluator is not self.evaluator:
            here = self._judged_by(evaluator, here)
        if here is self.base or at_noise_floor(here) or self.evaluator.original_integrator:
            return here
        other = with_original_integrator(self.evaluator, here)
        return here if other is None else self._judged_by(other[0], here)

    def _judged_by(self, evaluator: Evaluator, here: Evaluation) -> Evaluation:
        """The same hypothesis by another evaluator, which takes over; by this one where that cannot follow it."""
        base = evaluator.anew(self.base)
        again = base if here is self.base else evaluator.anew(here)
        if base is None or again is None:
            return here
        self.evaluator, self.base, self.current = evaluator, base, again
        self._best = {frozenset(one.hypothesis.keys): one for one in (base, again)}
        return again

    def pruned(self, here: Evaluation, entered: int = 1) -> Evaluation:
        """Without the additions that the rule would not let in any more; the last ``entered`` have just entered."""
        for key in here.hypothesis.keys[: len(here.hypothesis.keys) - entered]:
            without = self.evaluated_from(here, here.hypothesis.minus(key))
            if without is not here and refused(here, without, self.base) is not None:
                self.evaluator.watch(f"dropping {key}")
                return self.pruned(without, entered)
        return here


def promising(screened: Sequence[Prediction]) -> list[Prediction]:
    """Select the predictions to refit: the best, and the simplest, which go before their equals."""
    enough = [prediction for prediction in screened if prediction.gain >= LEAST_PREDICTED_GAIN]
    wider = [prediction for prediction in enough if isinstance(prediction.addition, WiderBounds)]
    simple = [prediction for prediction in enough if len(prediction.begun[0]) == 1][:1]
    return list({id(one): one for one in (*enough[:REFITS], *wider, *simple)}.values())


def _wanted(here: Evaluation, tried: Sequence[Trial]) -> float:
    """The score that another addition has to come down to, to be as good as the best that the rule prefers."""
    best = min((one.evaluation.fitted.score for one in tried if one.refused is None), default=math.inf)
    return best + RIVALS_MARGIN * max(0.0, here.fitted.score - best) if math.isfinite(best) else math.inf


def _alike(screened: Sequence[Prediction], tried: Sequence[Trial], chosen: Trial) -> tuple[Addition, ...]:
    """List the additions that are the same law as what was chosen, and were not refitted."""
    of = next(prediction for prediction in screened if prediction.addition == chosen.addition)
    known = {trial.addition.key for trial in tried}
    return tuple(p.addition for p in screened if p.addition.key not in known and p.alike(of))


def _equal(best: Trial, other: Trial) -> bool:
    return equally_good(best.evaluation.gains(other.evaluation), [one.gain for one in best.gains])


def _parameters(trial: Trial) -> tuple[int, int, float]:
    return len(trial.evaluation.fitted.theta), trial.addition.rank, -trial.least
