"""The explanation of a model's error from logs: the whole path from a problem to the hypothesis that explains them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.candidates.candidates import can_have, propose
from onlinebayes.criticism.hypotheses.additions import AddedEffect, FreedNumber, OwnValues
from onlinebayes.criticism.hypotheses.growing_lags import lag_growths
from onlinebayes.criticism.hypotheses.original_integrator import with_original_integrator
from onlinebayes.criticism.hypotheses.rounds import Round
from onlinebayes.criticism.hypotheses.search import Search
from onlinebayes.identification.data.noise import measured_floors
from onlinebayes.identification.data.windows import Windows, make_windows
from onlinebayes.identification.fitting.blocks import FEWEST_BLOCKS
from onlinebayes.identification.fitting.gauss_newton import MOST_STEPS
from onlinebayes.identification.fitting.theta import values_of
from onlinebayes.identification.fitting.window_length import all_windows, fit_base
from onlinebayes.identification.judging.evaluator import Evaluation, Evaluator, FitRequest, at_noise_floor, better
from onlinebayes.identification.judging.hypothesis import Addition, Hypothesis, build
from onlinebayes.identification.judging.rule import LEAST_GAIN
from onlinebayes.identification.scope import address_of
from onlinebayes.measurements import Measurement
from onlinebayes.runs import UNWATCHED, BadInput, Memo, NoMemo, Watch
from onlinebayes.simulators.effects import EFFECTS, Effect
from onlinebayes.simulators.identifiable import Identifiable

NOISE_ALONE = 0.5 * math.log(2.0)
"""A signal's part of the score where no more than noise is left [nats]."""

SCALES_HORIZON = 2.0
"""Seconds of the windows from which effects take their bounds: dead times up to a tenth of that are tried."""


@dataclass(frozen=True)
class Explanation:
    """The hypothesis that explains the logs, and the search that found it.

    Args:
        base, found: the model as it is, and the hypothesis of which no neighbour is preferred.
        rounds: of the search.
        evaluator: by which both were fitted and judged.
        rivals: what was found with another law in the place of its first addition, as good beside all else.
        shorter: the same over the windows of the search, where longer ones took their place.
    """

    base: Evaluation
    found: Evaluation
    rounds: tuple[Round, ...]
    evaluator: Evaluator
    rivals: tuple[Evaluation, ...] = ()
    shorter: Explanation | None = None

    @property
    def explains(self) -> bool:
        """True if something was found, or nothing but noise is left to be explained."""
        return self.found is not self.base or at_noise_floor(self.found)

    def on_all_windows(self, fit_runs: Measurement) -> Explanation:
        """With both fitted once more to all windows, where the search looked at a part of them.

        They are doubled as long as seven are left and what was found leaves no more over them: a longer window says far
        more of the parameters, and where more is left there, something is missing that the search has not seen.

        Args:
            fit_runs: the runs.
        """
        known, best = self.evaluator.windows, self
        for times in (1, 2, 4, 8, 16):
            windows = all_windows(self.evaluator.given, fit_runs, times * known.horizon, known.noise)
            if windows.rows < times * known.rows or (times > 1 and windows.count < FEWEST_BLOCKS):
                break
            longer = best._over(windows, quieter=times > 1)
            if longer is None:
                break
            best = longer
        return best if best is self else replace(best, shorter=self)

    def _over(self, windows: Windows, *, quieter: bool) -> Explanation | None:
        """With both fitted to other windows; None where one diverges, or what was found has to leave no more and does.

        The base model comes last: it is not asked where the windows are refused.
        """
        most = _most_left(self.found) if quieter else None
        fitted = self._found_over(windows, math.inf if most is None else float(most.sum()))
        if fitted is None:
            return None
        evaluator, found = fitted
        if most is not None and not bool((found.left_out[0].by_signal <= most).all()):
            return None
        if found is self.found:
            return self
        if self.found is self.base:
            return replace(self, base=found, found=found, evaluator=evaluator)
        # Over longer windows a wrong model fits worse: it would be made out worse than it is.
        steps = 0 if quieter else MOST_STEPS
        base = evaluator.evaluate(FitRequest(self.base.hypothesis, [self.base.values], most=steps))
        return None if base is None else replace(self, base=base, found=found, evaluator=evaluator)

    def _found_over(self, windows: Windows, wanted: float) -> tuple[Evaluator, Evaluation] | None:
        """Fit the found hypothesis to other windows, integrated as these ask for; None above the wanted score."""
        evaluator, found = self.evaluator, self.found
        if windows.spans != evaluator.windows.spans:
            evaluator = replace(evaluator, windows=windows)
            longer = evaluator.evaluate(FitRequest(found.hypothesis, [found.values], wanted=wanted))
            if longer is None:
                return None
            found = longer
        if (finer := evaluator.refined(found)) is not evaluator:
            # Over a longer window a step errs by more.
            again = finer.anew(found)
            if again is None:
                return None
            evaluator, found = finer, again
        if found.fitted.score > wanted:
            return None
        return (
            (evaluator, found)
            if evaluator.original_integrator
            else with_original_integrator(evaluator, found) or (evaluator, found)
        )

    @property
    def model(self) -> Identifiable:
        """The simulator of the found hypothesis, at the model's own step."""
        return build(self.evaluator.given, self.found.hypothesis, self.evaluator.runs)

    @property
    def windows(self) -> Windows:
        """On which it was judged."""
        return self.evaluator.windows


def _most_left(before: Evaluation) -> Float[Tensor, " S"]:
    """Return the most that longer windows may leave of each signal: as before, or too little for any addition [nats].

    A fit that long windows led astray leaves more, and its parameters are worth less than those of shorter ones.
    """
    return before.left_out[0].by_signal.clamp_min(NOISE_ALONE + LEAST_GAIN)


def start_search(
    given: Identifiable, fit_runs: Measurement, watch: Watch = UNWATCHED, memo: Memo | None = None
) -> Search:
    """A search that stands at the base model.

    Args:
        given: the model, in step with the log.
        fit_runs: what it is fitted to.
        watch: told what is being done.
        memo: keeps fits for the next command.

    Raises:
        BadInput: the model cannot follow the measurement.
        Stopped: it was interrupted.
    """
    with watch.heeded():
        evaluator, base = _base(given, fit_runs, watch, memo or NoMemo())
        if not at_noise_floor(base):
            evaluator, base = with_original_integrator(evaluator, base) or (evaluator, base)
        return Search(evaluator, base, ())


def run_search(search: Search, fit_runs: Measurement, candidates: str | Sequence[str | Effect], *, most: int) -> Search:
    """The search at its end; where it is interrupted, ``search`` holds what was found until then.

    Args:
        search: of :func:`start_search`.
        fit_runs: as there.
        candidates: ``"all"``, or names, ``name@target`` keys and effects with bounds of their own; none: no search.
        most: additions at which the search ends.
    """
    if not candidates:
        return search
    given, search.most = search.evaluator.given, most
    search.candidates = additions(given, fit_runs, candidates)
    if candidates == "all" and not at_noise_floor(search.base):
        search.candidates += clocks(given, fit_runs, search)
    search.last = flexible(given, fit_runs) if candidates == "all" else ()
    return _run(search, search.last)


def explanation_of(search: Search) -> Explanation:
    """Return the explanation that a search has found so far."""
    return Explanation(search.base, search.current, (*search.rounds, *search.pending), search.evaluator)


def _run(search: Search, last: Sequence[Addition]) -> Search:
    """The search; anew, run as a simulator would have, where the log follows what was found far better so."""
    found = search.run()
    other = None if at_noise_floor(found) or found is search.base else with_original_integrator(search.evaluator, found)
    if other is None:
        return search
    evaluator, _ = other
    base = evaluator.evaluate(FitRequest(Hypothesis(), [search.base.values], search.base.fitted.lin.starts))
    if base is None:
        return search
    anew = Search(evaluator, base, search.candidates, last, search.most)
    anew.run()
    return anew


def _base(given: Identifiable, fit_runs: Measurement, watch: Watch, memo: Memo) -> tuple[Evaluator, Evaluation]:
    """The base model fitted, and by what."""
    watch.say("choosing the windows")
    begun = fit_base(given, fit_runs, measured_floors(fit_runs), memo)
    evaluator = Evaluator(given, begun.windows, fit_runs.runs, begun.discretisation, watch.say, memo=memo)
    values = values_of(begun.fitted.simulator, begun.fitted.theta)
    base = evaluator.evaluate(FitRequest(Hypothesis(), [values], begun.fitted.lin.starts))
    if base is None:
        raise BadInput("the model cannot follow the measurement", "check the model, its time step and its bounds")
    # A valley that shorter windows led into need not be the deepest. An effect that was added by hand may do nothing
    # where its bounds begin.
    added = [
        {**values, **start.values}
        for values in ({}, base.values)
        for effect in given.effects
        for start in AddedEffect(effect).starts(given, values)
    ]
    again = evaluator.evaluate(FitRequest(Hypothesis(), [{}, *added], wanted=base.fitted.score))
    best = better(again, base) or base
    if best is base or not begun.lost:
        return evaluator, best
    # From there the model may follow the log for longer.
    begun = fit_base(given, fit_runs, measured_floors(fit_runs), memo, best.values)
    if begun.windows.horizon <= evaluator.windows.horizon:
        return evaluator, best
    longer = Evaluator(given, begun.windows, fit_runs.runs, begun.discretisation, watch.say, memo=memo)
    values = values_of(begun.fitted.simulator, begun.fitted.theta)
    anew = longer.evaluate(FitRequest(Hypothesis(), [values], begun.fitted.lin.starts))
    return (evaluator, best) if anew is None else (longer, anew)


def additions(
    simulator: Identifiable, measurement: Measurement, wanted: str | Sequence[str | Effect] = "all"
) -> tuple[Addition, ...]:
    """Everything that is tried; a law that is the exact sum of others is tried as these."""
    windows = make_windows(simulator, measurement, SCALES_HORIZON)
    effects = [effect for effect in propose(simulator, windows, wanted) if not effect.sum_of]
    found: list[Addition] = [AddedEffect(effect) for effect in effects]
    if wanted != "all":
        return tuple(found)
    if len(windows.runs) > 1:
        found += [AddedEffect(effect, per_run=True) for effect in effects if effect.tried_per_run]
    found += [FreedNumber(address, bounds) for address, bounds in simulator.own_numbers.items()]
    return tuple(found)


def clocks(simulator: Identifiable, measurement: Measurement, search: Search) -> tuple[Addition, ...]:
    """What is tried only at signals whose lag grows along a run, at those."""
    grown = [one.signal for one in lag_growths(search.base.fitted, search.evaluator.windows) if one.certain]
    vocabulary = {**EFFECTS, **simulator.own_effects}
    kinds = [name for name, kind in vocabulary.items() if kind.tried_where_lag_grows]
    places = [f"{kind}@{signal}" for kind in kinds for signal in grown if signal in simulator.targets("signal")]
    return additions(simulator, measurement, places) if places else ()


def flexible(simulator: Identifiable, measurement: Measurement) -> tuple[Addition, ...]:
    """Laws with so much freedom that they find something in whatever another law leaves.

    Cogging with its period and phase, wind with the drag that it needs, for each free parameter that is no constant of
    nature a drift and a step in time, and one value a run: that is fitted inside the run that it predicts.
    """
    windows = make_windows(simulator, measurement, SCALES_HORIZON)
    vocabulary = {**EFFECTS, **simulator.own_effects}
    last = [name for name, kind in vocabulary.items() if kind.tried_last and kind.target_kind != "parameter"]
    free = [name for name in simulator.targets("parameter") if name in simulator.parameters and "@" not in name]
    changing = [kind.name for kind in vocabulary.values() if kind.tried_last and kind.target_kind == "parameter"]
    last += [f"{kind}@{name}" for name in free if not name.startswith("option.") for kind in changing]
    effects = [effect for name in last for effect in propose(simulator, windows, [name])]
    shared = [name for name in simulator.parameters if name == address_of(name) and "@" not in name]
    return (
        *(AddedEffect(effect) for effect in effects if can_have(simulator, effect)),
        *(OwnValues(name) for name in shared if len(windows.runs) > 1),
    )
