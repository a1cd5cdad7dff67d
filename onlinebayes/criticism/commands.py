"""The public functions ``compare``, ``diagnose`` and ``refine``, each from built objects to a :class:`.Criticism`.

fit runs: base model -> wiring and effects (see ``inquiry``) -> final model
held-out runs: opened once, for the reported error (see ``assembly``)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from onlinebayes.criticism.answer import answered
from onlinebayes.criticism.assembly import assemble
from onlinebayes.criticism.hypotheses.explaining import begun, searched
from onlinebayes.criticism.hypotheses.search import MOST_ADDITIONS
from onlinebayes.criticism.inquiry import first_fit, inquire, suspect
from onlinebayes.criticism.mending import Mended, mended
from onlinebayes.criticism.results import Criticism, Question
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.delays_from_idle import late_from_idle
from onlinebayes.criticism.searching.search import MOST_EFFECTS, SearchResult, enough_motion, ground
from onlinebayes.criticism.slow_effects import adds_to, dropped_by
from onlinebayes.criticism.task import Task, prepare
from onlinebayes.criticism.timing import Stopwatch
from onlinebayes.identification.fitting.before_runs import reread
from onlinebayes.identification.fitting.numerics import Grounds
from onlinebayes.identification.fitting.projection import misfit
from onlinebayes.identification.results import Selection
from onlinebayes.identification.scope import Scope
from onlinebayes.measurements import Measurement
from onlinebayes.runs import Interrupt, Watch, one_torch_thread
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.identifiable import Identifiable

Say = Callable[[str], None]


@one_torch_thread()
def compare(
    simulator: Identifiable,
    measurement: Measurement,
    *,
    holdout: Sequence[str] | None = None,
    selection: Selection | None = None,
    scope: Scope | None = None,
    progress: Say | None = None,
    interrupt: Interrupt | None = None,
) -> Criticism:
    """Fit what is free, replay, and show where the model fails; no effect is tried.

    A model that errs is ``unexplained``, then, unless the data are at fault or too few.

    Args:
        simulator: the model; its parameters are free within their bounds.
        measurement: runs of commands and signals; every joint needs its position or its velocity.
        holdout: runs kept for the reported error; None for the last third of the runs, or of the only run's time.
        selection: how effects are judged.
        scope: which parameters differ between runs; None for none.
        progress: takes one line of text between stages; one that ends in a full stop is an answer, to be kept.
        interrupt: ends the work at its next replay, without the wiring check and longer windows.

    Raises:
        BadInput: the measurement does not suit the simulator, or the simulation diverges.
        Stopped: it was interrupted before the base model was fitted.
    """
    stopwatch = Stopwatch(progress)
    watch = Watch(stopwatch, interrupt)
    fault = None
    with watch.heeded():
        task = prepare(simulator, measurement, holdout, selection, scope)
        base = first_fit(task.simulator, task.fit_runs, task.selection, watch)
        found = SearchResult(base, base, enough=enough_motion(base, task.selection))
    with watch.giving_up():
        fault = suspect(base, task.simulator, task.fit_runs, task.selection, watch)
        if fault is None and (longer := task.slower(found, watch)) is not None:
            base = ground(task.simulator, task.fit_runs, longer)
            task, found = task.over(longer), SearchResult(base, base)
    return assemble("compare", task, replace(found, interrupted=watch.stopped), fault, stopwatch)


@one_torch_thread()
def diagnose(
    simulator: Identifiable,
    measurement: Measurement,
    *,
    holdout: Sequence[str] | None = None,
    selection: Selection | None = None,
    scope: Scope | None = None,
    candidates: str | Sequence[str | Effect] = "all",
    progress: Say | None = None,
    interrupt: Interrupt | None = None,
) -> Criticism:
    """As :func:`compare`, then rank the effects that could be missing and judge what the best alone would give.

    Args:
        candidates: ``"all"``, or effect names, ``name@target`` keys and effects with bounds of their own.
        interrupt: stops the search at its next replay; what was found until then is returned.

    Raises:
        BadInput, Stopped: as :func:`compare`.
    """
    ask = partial(prepare, simulator, measurement, holdout, selection, scope)
    return _searched("diagnose", ask, candidates, 1, progress, interrupt)


@one_torch_thread()
def refine(
    simulator: Identifiable,
    measurement: Measurement,
    *,
    holdout: Sequence[str] | None = None,
    selection: Selection | None = None,
    scope: Scope | None = None,
    candidates: str | Sequence[str | Effect] = "all",
    progress: Say | None = None,
    interrupt: Interrupt | None = None,
) -> Criticism:
    """Add the best missing effect, refit, and again until the verdict stands; arguments as :func:`diagnose`."""
    ask = partial(prepare, simulator, measurement, holdout, selection, scope)
    return _searched("refine", ask, candidates, MOST_EFFECTS, progress, interrupt)


def _searched(
    question: Question,
    ask: Callable[[], Task],
    candidates: str | Sequence[str | Effect],
    most: int,
    progress: Say | None,
    interrupt: Interrupt | None,
) -> Criticism:
    """The answer to what is asked, after a search for at most so many effects."""
    stopwatch = Stopwatch(progress)
    watch = Watch(stopwatch, interrupt)
    with watch.heeded():
        task = ask()
        base = first_fit(task.simulator, task.fit_runs, task.selection, watch)
    context = SearchContext(task.fit_runs, task.selection, candidates, watch)
    task, base = _as_begun(task, base, context)
    context = replace(context, measurement=task.fit_runs)
    found, fault = inquire(task.simulator, context, most, base)
    if fault is None and not watch.stopped:
        task, found = _read_otherwise(task, found, context, most)
        context = replace(context, measurement=task.fit_runs)
        task, found = _over_longer(task, found, context, most)
    stopped = watch.stopped
    result = assemble(question, task, found, fault, stopwatch)
    return replace(result, interrupted=result.interrupted or stopped)


def _as_begun(task: Task, base: Grounds, context: SearchContext) -> tuple[Task, Grounds]:
    """The task and its base model, with no command before the runs where late actuators explain far more so."""
    idle = False
    with context.watch.giving_up():
        idle = late_from_idle(base, context)
    if not idle:
        return task, base
    task = task.begun(idle=True)
    return task, reread(base, task.fit_runs)


def _read_otherwise(task: Task, found: SearchResult, context: SearchContext, most: int) -> tuple[Task, SearchResult]:
    """The task and what was found, with the log read otherwise where that explains far more."""
    other: Task | None = None
    again: SearchResult | None = None
    with context.watch.giving_up():
        other = task.read_otherwise(found)
        if other is not None:
            context.watch.say("reading the log otherwise")
            again, fault = inquire(other.simulator, replace(context, measurement=other.fit_runs), most)
            better = misfit(again.final.fitted.projected) < misfit(found.final.fitted.projected)
            again = again if better and fault is None else None
    return (task, found) if other is None or again is None else (other, again)


def _over_longer(task: Task, found: SearchResult, context: SearchContext, most: int) -> tuple[Task, SearchResult]:
    """The task and what was found, over longer windows where these show more; see :mod:`.slow_effects`."""
    longer: Selection | None = None
    again: SearchResult | None = None
    stands = False
    with context.watch.giving_up():
        longer = task.slower(found, context.watch)
        if longer is not None:
            again, fault = inquire(task.simulator, replace(context, selection=longer), most)
            stands = fault is None and adds_to(again, found, task.fit_runs, task.selection)
    if longer is None:
        return task, found
    if again is None or not stands:
        return task.unexplained_over(longer, again), found
    return task.over(longer, dropped_by(again, found)), again


def answer(
    question: Question,
    simulator: Identifiable,
    measurement: Measurement,
    *,
    holdout: Sequence[str] | None = None,
    selection: Selection | None = None,
    scope: Scope | None = None,
    candidates: str | Sequence[str | Effect] = "all",
    progress: Say | None = None,
    interrupt: Interrupt | None = None,
) -> Criticism:
    """What :func:`compare`, :func:`diagnose` and :func:`refine` answer, by the search that is to replace theirs.

    Args:
        question: which of them asks; the others as there.

    Raises:
        BadInput, Stopped: as :func:`compare`.
    """
    stopwatch = Stopwatch(progress)
    watch = Watch(stopwatch, interrupt)
    most = {"compare": 0, "diagnose": 1, "refine": MOST_ADDITIONS}[question]
    with watch.heeded():
        task = prepare(simulator, measurement, holdout, selection, scope)
    search = begun(task.simulator, task.fit_runs, watch)
    fault: Mended | None = None
    with watch.giving_up():
        fault = mended(search.evaluator, search.base, task.fit_runs)
    certain = fault is not None and fault.certain
    found = searched(search, task.fit_runs, candidates if most and not certain else (), most=most, watch=watch)
    if fault is not None and not certain and (not most or not fault.as_good_as(found.found, found.base)):
        fault = None  # where no law was asked, only what leaves noise is believed
    return replace(answered(question, task, found, fault, stopwatch), interrupted=watch.stopped)
