"""The public functions ``compare``, ``diagnose`` and ``refine``, each from built objects to a :class:`.Criticism`.

fit runs: base model -> faults of the log -> what is missing or off (see ``hypotheses``) -> final model
held-out runs: what makes their error rise is taken out, then that error is reported (see ``answer``)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from onlinebayes.criticism.answer import answered
from onlinebayes.criticism.criticism import Criticism
from onlinebayes.criticism.hypotheses.explanation import (
    Explanation,
    explanation_of,
    run_search,
    start_search,
)
from onlinebayes.criticism.hypotheses.search import MOST_ADDITIONS, Search
from onlinebayes.criticism.hypotheses.weighing import settled
from onlinebayes.criticism.log_faults import CorrectedLog, find_fault, switched_off
from onlinebayes.criticism.prepared_log import PreparedLog, prepare
from onlinebayes.criticism.reading import begun_as_read, better_read
from onlinebayes.criticism.results import Question
from onlinebayes.criticism.timing import Stopwatch
from onlinebayes.criticism.wiring.dead_commands import check_driven
from onlinebayes.criticism.wiring.units import unit_that_fits
from onlinebayes.identification.judging.evaluator import at_noise_floor
from onlinebayes.identification.judging.skill import has_skill, unskilled
from onlinebayes.identification.results import Selection
from onlinebayes.identification.scope import Scope
from onlinebayes.measurements import Measurement
from onlinebayes.runs import Attempts, BadInput, Interrupt, Memo, Stopped, Watch, one_torch_thread
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.identifiable import Identifiable

Say = Callable[[str], None]
Candidates = str | Sequence[str | Effect]

BUDGET_S = 300.0
"""Seconds of processor time, once the base model is fitted, after which a command gives the best answer so far."""


def compare(
    simulator: Identifiable,
    measurement: Measurement,
    *,
    holdout: Sequence[str] | None = None,
    selection: Selection | None = None,
    scope: Scope | None = None,
    progress: Say | None = None,
    interrupt: Interrupt | None = None,
    memo: Memo | None = None,
    budget_s: float | None = BUDGET_S,
) -> Criticism:
    """Fit what is free, replay, and show where the model fails; no effect is tried.

    A model that errs is ``unexplained``, then, unless the data are at fault or too few.

    Args:
        simulator: the model; its parameters are free within their bounds.
        measurement: runs of commands and signals; every joint needs its position or its velocity.
        holdout: runs kept for the reported error; None for the last third of the runs, or of the only run's time.
        selection: the length of the windows that errors are reported for, and what counts as adequate.
        scope: which parameters differ between runs; None for none.
        progress: takes one line of text between stages; one that ends in a full stop is an answer, to be kept.
        interrupt: ends the work at its next replay.
        memo: keeps fits, so that the next command on this model and log does not work them out again; None for none.
        budget_s: processor time [s], once the base model is fitted, after which the best answer so far is given; None
            for no end.

    Raises:
        BadInput: the measurement does not suit the simulator, or the simulation diverges.
        Stopped: it was interrupted before the base model was fitted.
    """
    with one_torch_thread():
        stopwatch, task = _asked(simulator, measurement, holdout, selection, scope, progress, interrupt)
        return _answered("compare", task, (), 0, stopwatch, interrupt, budget_s, memo)


def diagnose(
    simulator: Identifiable,
    measurement: Measurement,
    *,
    holdout: Sequence[str] | None = None,
    selection: Selection | None = None,
    scope: Scope | None = None,
    candidates: Candidates = "all",
    progress: Say | None = None,
    interrupt: Interrupt | None = None,
    memo: Memo | None = None,
    budget_s: float | None = BUDGET_S,
) -> Criticism:
    """As :func:`compare`, then rank what could be missing and judge what the best alone would give.

    Args:
        candidates: ``"all"``, or effect names, ``name@target`` keys and effects with bounds of their own.
        interrupt: stops the search at its next replay; what was found until then is returned.

    Raises:
        BadInput, Stopped: as :func:`compare`.
    """
    with one_torch_thread():
        stopwatch, task = _asked(simulator, measurement, holdout, selection, scope, progress, interrupt)
        return _answered("diagnose", task, candidates, 1, stopwatch, interrupt, budget_s, memo)


def refine(
    simulator: Identifiable,
    measurement: Measurement,
    *,
    holdout: Sequence[str] | None = None,
    selection: Selection | None = None,
    scope: Scope | None = None,
    candidates: Candidates = "all",
    progress: Say | None = None,
    interrupt: Interrupt | None = None,
    memo: Memo | None = None,
    budget_s: float | None = BUDGET_S,
    faults: bool = True,
) -> Criticism:
    """Add what is missing, refit, and again until nothing more is preferred; arguments as :func:`diagnose`.

    Args:
        faults: whether faults of the log (signs, units, columns, actuators that were off) are tried beside what the
            model may lack; a table that a program wrote itself has none.
    """
    with one_torch_thread():
        stopwatch, task = _asked(simulator, measurement, holdout, selection, scope, progress, interrupt)
        return _answered("refine", task, candidates, MOST_ADDITIONS, stopwatch, interrupt, budget_s, memo, faults)


@dataclass(frozen=True, eq=False)
class Found:
    """An answer before it is put together.

    Args:
        task: how the runs were read.
        explanation: what was found in the fit runs.
        fault: of the log, where that explains as much.
    """

    task: PreparedLog
    explanation: Explanation
    fault: CorrectedLog | None = None


def _asked(
    simulator: Identifiable,
    measurement: Measurement,
    holdout: Sequence[str] | None,
    selection: Selection | None,
    scope: Scope | None,
    progress: Say | None,
    interrupt: Interrupt | None,
) -> tuple[Stopwatch, PreparedLog]:
    """The model and the runs made ready, and what has timed that."""
    stopwatch = Stopwatch(progress)
    with Watch(stopwatch, interrupt).heeded():
        return stopwatch, prepare(simulator, measurement, holdout, selection, scope)


def _answered(
    question: Question,
    task: PreparedLog,
    candidates: Candidates,
    most: int,
    stopwatch: Stopwatch,
    interrupt: Interrupt | None,
    budget_s: float | None,
    memo: Memo | None,
    faults: bool = True,
) -> Criticism:
    """The base model fitted, the log's faults and the model's tried under one rule, the held-out runs opened.

    Once the base model is fitted there is an answer: whatever fails later is noted, and the best one so far is given.
    """
    task, search = _begun(task, Watch(stopwatch, interrupt), memo)
    watch, attempts = Watch(stopwatch, interrupt).within(budget_s), Attempts()
    watch.say(_provisional(search))
    if faults and (lost := unskilled(search.base, search.evaluator)):
        check_driven(task.fit_runs, lost)
    search.evaluator.watch = watch.say
    answers = _answers(task, search, candidates, most, watch, attempts, faults)
    stopped, spent = watch.stopped, watch.spent
    result = _first_that_can_be_given(question, answers[::-1], stopwatch, attempts)
    notes = (*result.notes, *attempts.failed)
    if spent:
        notes += (f"the budget of {budget_s:g} s of processor time was spent: this is the best found until then",)
    return replace(result, interrupted=stopped and not spent, notes=notes, failed=tuple(attempts.failed))


def _begun(task: PreparedLog, watch: Watch, memo: Memo | None) -> tuple[PreparedLog, Search]:
    """The base model fitted, the log read as it asks.

    Where it cannot follow the log, what is said names the unit with which it could.
    """
    try:
        return begun_as_read(task, watch, memo)
    except Stopped:
        raise
    except BadInput as error:
        watch.say("the model cannot follow the log: trying other units")
        with watch.heeded():
            unit = unit_that_fits(task.simulator, task.fit_runs, partial(_followed, task.simulator))
        if unit is None:
            raise
        problem = f"the model cannot follow the log as it is read, and could with another unit ({unit.says})"
        raise BadInput(problem, f"if that is so, give each of them scale = {unit.factor:.9g} in [signals]") from error


def _provisional(search: Search) -> str:
    """A first answer, while everything else is still to be looked at."""
    times, signal = search.base.left_out[0].rms.max(0)
    columns = search.evaluator.windows.columns
    name = search.evaluator.given.signals[columns[int(signal)]]
    return f"so far: the model as it is errs by {float(times):.2g} times the noise in {name}."


def _followed(simulator: Identifiable, fit_runs: Measurement) -> bool:
    """Check whether the base model follows the runs better than a line through each window does."""
    search = start_search(simulator, fit_runs)
    return has_skill(search.base, search.evaluator)


def _answers(
    task: PreparedLog, search: Search, candidates: Candidates, most: int, watch: Watch, attempts: Attempts, faults: bool
) -> list[Found]:
    """One answer after the other, each better than the one before it; the first is the base model."""
    answers, fault = [Found(task, explanation_of(search))], None
    with watch.giving_up(), attempts.attempt("checking signs, units and columns"):
        fault = find_fault(search.evaluator, search.base, task.fit_runs, laws=bool(most)) if faults else None
    certain = fault is not None and fault.certain
    with watch.giving_up(), attempts.attempt("the search"):
        search = run_search(search, task.fit_runs, candidates if most and not certain else (), most=most)
    answers.append(Found(task, explanation_of(search)))
    anew: Search | None = None
    with watch.giving_up(), attempts.attempt("the search with the log read otherwise"):
        other = (
            None if fault is not None or at_noise_floor(search.current) else better_read(task, search, search.current)
        )
        if other is not None:
            task, anew = other, start_search(other.simulator, other.fit_runs, watch, search.evaluator.memo)
            anew = run_search(anew, other.fit_runs, candidates if most else (), most=most)
    if anew is not None:
        answers.append(Found(task, explanation_of(anew)))
    found = answers[-1].explanation
    with watch.giving_up(), attempts.attempt("checking whether an actuator was off"):
        if faults and fault is None and most and not at_noise_floor(found.found):
            fault = switched_off(found.evaluator, found.base, answers[-1].task.fit_runs)
    with attempts.attempt("weighing the log's fault against the model's"):
        if fault is not None and (fault.certain or (most and fault.as_good_as(found.found, found.base))):
            answers.append(replace(answers[-1], fault=fault))  # with no law asked only what leaves noise is believed
    with watch.giving_up(), attempts.attempt("fitting to all windows"):
        # Where nothing explains the misfit, more of the data says no more of parameters that are wrong.
        if found.explains:
            watch.say("fitting to all windows")
            found = found.on_all_windows(answers[-1].task.fit_runs)
        answers.append(replace(answers[-1], explanation=settled(found)))
    return answers


def _first_that_can_be_given(
    question: Question, answers: Sequence[Found], stopwatch: Stopwatch, attempts: Attempts
) -> Criticism:
    """The first of some answers that can be put together; raises what the last one raises."""
    *better, last = answers
    for found in better:
        with attempts.attempt("putting the answer together"):
            return answered(question, found.task, found.explanation, found.fault, stopwatch, attempts)
    return answered(question, last.task, last.explanation, last.fault, stopwatch, attempts)
