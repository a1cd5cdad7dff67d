"""The three questions: where is the model wrong, what is missing, and how good is it with what was missing.

fit runs: base model -> wiring and effects (see ``inquiry``) -> final model
held-out runs: opened once, for the reported error
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import torch

from onlinebayes.criticism.detail import Detail
from onlinebayes.criticism.findings.answers import parameter_changes, widened_bounds, wiring_of
from onlinebayes.criticism.findings.carried_over import errors_on_the_way, in_vain_note, worse_runs_note
from onlinebayes.criticism.findings.fit_notes import fit_notes
from onlinebayes.criticism.findings.log_notes import log_notes
from onlinebayes.criticism.findings.opening import opened
from onlinebayes.criticism.findings.ranking import rank, steps
from onlinebayes.criticism.fitting.blocks import Blocks
from onlinebayes.criticism.fitting.fit import residual_correlation_time
from onlinebayes.criticism.fitting.heldout import replay_runs
from onlinebayes.criticism.fitting.identifiability import covariance_of, estimates, flat_directions
from onlinebayes.criticism.fitting.numerics import Grounds
from onlinebayes.criticism.inquiry import inquire, suspect
from onlinebayes.criticism.judging.held_starts import starts_note
from onlinebayes.criticism.judging.localise import failures
from onlinebayes.criticism.judging.verdict import decide, left_over, what_to_record
from onlinebayes.criticism.replaying.ladder import Rung
from onlinebayes.criticism.results import (
    Criticism,
    FittedModel,
    HeldOutError,
    Remainder,
    ReplayedRun,
    Selection,
)
from onlinebayes.criticism.scope import Scope
from onlinebayes.criticism.searching.search import MOST_EFFECTS, Found, enough, ground
from onlinebayes.criticism.searching.stage import blocks_for
from onlinebayes.criticism.searching.ties import alternatives
from onlinebayes.criticism.slow_effects import adds_to
from onlinebayes.criticism.task import Task, prepared
from onlinebayes.criticism.timing import Stopwatch
from onlinebayes.criticism.wiring.as_given import as_given
from onlinebayes.criticism.wiring.late_starts import windows_to_replay
from onlinebayes.criticism.wiring.wiring import Suspicion
from onlinebayes.measurements import Measurement
from onlinebayes.runs import Interrupt, one_torch_thread
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.effects import Effect

Say = Callable[[str], None]
Question = Literal["compare", "diagnose", "refine"]


def _stopped(interrupt: Interrupt | None) -> bool:
    return interrupt is not None and interrupt.requested


@one_torch_thread()
def compare(
    simulator: Simulator,
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
        interrupt: ends the work after the fit in hand, without the wiring check and longer windows.

    Raises:
        BadInput: the measurement does not suit the simulator, or the simulation diverges.
    """
    say = Stopwatch(progress or _silent)
    task = prepared(simulator, measurement, holdout, selection, scope)
    if first := as_given(task.simulator, task.fit_runs, task.selection):
        say(first)
    say("fitting the base model")
    base = ground(task.simulator, task.fit_runs, task.selection)
    fault = None if _stopped(interrupt) else suspect(base, task.simulator, task.fit_runs, task.selection, say)
    found = Found(base, base, (), (), (), interrupted=_stopped(interrupt), enough=enough(base, task.selection))
    if fault is None and not _stopped(interrupt) and (longer := task.slower(found, say)) is not None:
        task, base = task.over(longer), ground(task.simulator, task.fit_runs, longer)
        found = Found(base, base, (), (), ())
    return _assemble("compare", task, found, fault, say)


def diagnose(
    simulator: Simulator,
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
        interrupt: stops the search after the fit in hand; what was found until then is returned.
    """
    return _searched("diagnose", simulator, measurement, holdout, selection, scope, candidates, 1, progress, interrupt)


def refine(
    simulator: Simulator,
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
    return _searched(
        "refine", simulator, measurement, holdout, selection, scope, candidates, MOST_EFFECTS, progress, interrupt
    )


@one_torch_thread()
def _searched(
    question: Question,
    simulator: Simulator,
    measurement: Measurement,
    holdout: Sequence[str] | None,
    selection: Selection | None,
    scope: Scope | None,
    candidates: str | Sequence[str | Effect],
    most: int,
    progress: Say | None,
    interrupt: Interrupt | None,
) -> Criticism:
    say = Stopwatch(progress or _silent)
    task = prepared(simulator, measurement, holdout, selection, scope)
    found, fault = inquire(task.simulator, task.fit_runs, task.selection, candidates, most, say, interrupt)
    stopped = _stopped(interrupt)
    if fault is None and not stopped and (longer := task.slower(found, say)) is not None:
        again, late_fault = inquire(task.simulator, task.fit_runs, longer, candidates, most, say, interrupt)
        if late_fault is None and adds_to(again, found, task.simulator, longer):
            task, found = task.over(longer), again
        else:
            task = task.unexplained_over(longer)
    return _assemble(question, task, found, fault, say)


def _assemble(
    question: Question,
    task: Task,
    found: Found,
    fault: Suspicion | None,
    say: Stopwatch,
) -> Criticism:
    simulator, fit_runs, held_runs, selection = task.simulator, task.fit_runs, task.held_runs, task.selection
    base, final = found.base, found.final
    signals = tuple(signal.name for signal in fit_runs.signals)
    units = {signal.name: signal.unit for signal in fit_runs.signals}
    blocks = blocks_for(final.fitted, final.windows, selection.folds)
    correlation = residual_correlation_time(final.fitted, final.windows)
    say("comparing with its equals" if found.accepted else "weighing what is left")
    equal = alternatives(found.simulator(simulator), found, selection.folds)
    before, after = (left_over(grounds, simulator) for grounds in (base, final))
    base_blocks = blocks_for(base.fitted, base.windows, selection.folds)
    verdict = decide(
        found.enough,
        found.undecided,
        base.numerics,
        len(found.accepted),
        bool(found.accepted and equal[found.accepted[0][1].effect.key]),
        found.widened is not None,
        before,
        after,
        selection.tolerance,
        fault is not None and (fault.certain or question != "compare"),
        bool(found.changes),
    )
    say("opening the held-out runs")
    # One step for both models: rows are cut to whole steps, and the two replays are shown row beside row.
    step = min(model.timestep for model in (simulator, base.fitted.simulator, final.fitted.simulator))
    base_model = _model(base, step, base_blocks, fit_runs, held_runs, selection)
    final_model = base_model if final is base else _model(final, step, blocks, fit_runs, held_runs, selection)
    held = windows_to_replay(
        final_model.simulator, held_runs, final_model.theta, selection.horizon_s, final.windows.noise
    )
    heldout_error, detail = opened(base_model, final_model, held, signals, units)
    flat = flat_directions(final.fitted, correlation, final.windows.bin_step)
    candidates = rank(found, equal, final_model.parameters)
    return Criticism(
        command=question,
        verdict=verdict,
        accepted=tuple(judged.effect.key for _, judged in found.accepted),
        remainder=_remainder(final, after, units, selection),
        heldout_error=heldout_error,
        steps=steps(found),
        candidates=candidates,
        candidates_tried=len(found.effects),
        holdout_looks=1,
        failures=failures(base.fitted, base.windows, units),
        parameters=final_model.parameters,
        flat_directions=flat,
        numerics=final.numerics,
        base=base_model,
        final=final_model,
        signals=signals,
        commands=tuple(simulator.commands),
        units=units,
        sensor_sd=dict(zip(signals, base.windows.noise.tolist(), strict=True)),
        selection=selection,
        what_to_record=_what_to_record(base, base_blocks) if verdict == "insufficient_data" else "",
        interrupted=found.interrupted,
        notes=(
            *task.notes,
            *fit_notes(simulator, found, selection, final_model.parameters),
            *(_carried_over(found, step, held_runs, selection, heldout_error, detail, units) if found.accepted else ()),
            *starts_note(final_model, held, heldout_error, selection.tolerance),
            *log_notes(candidates, final_model.parameters, simulator.commands, signals),
        ),
        widened=widened_bounds(found),
        detail=detail,
        timings=say.timings(),
        wiring=None if fault is None else wiring_of(fault),
        changes=parameter_changes(found, final_model.parameters),
    )


def _what_to_record(base: Grounds, blocks: Blocks) -> str:
    """What would decide; see :func:`.judging.verdict.what_to_record`."""
    moves = bool(base.windows.observed.any())
    return what_to_record(blocks.count, moves, base.windows, residual_correlation_time(base.fitted, base.windows))


def _carried_over(
    found: Found,
    step: float,
    held_runs: Measurement,
    selection: Selection,
    error: HeldOutError,
    detail: Detail,
    units: dict[str, str],
) -> tuple[str, ...]:
    """Notes on what was accepted and does not hold in the held-out runs."""
    on_the_way = errors_on_the_way(found.accepted, step, held_runs, selection.horizon_s)
    last = found.accepted[-1][1].effect.key
    in_vain = in_vain_note(error.before, on_the_way, last, error.after, units)
    return (*worse_runs_note(detail.windows, units), *in_vain)


def _model(
    grounds: Grounds,
    step: float,
    blocks: Blocks,
    fit_runs: Measurement,
    held_runs: Measurement,
    selection: Selection,
) -> FittedModel:
    """The fitted model integrated with ``step`` [s], with its replays at every row."""
    fitted = grounds.fitted
    model = Rung(step).of(fitted.simulator)
    covariance = covariance_of(fitted, blocks) + torch.outer(grounds.shift, grounds.shift)
    flat = flat_directions(fitted, residual_correlation_time(fitted, grounds.windows), grounds.windows.bin_step)
    replays: list[ReplayedRun] = []
    for runs, held_out in ((fit_runs, False), (held_runs, True)):
        windows = windows_to_replay(model, runs, fitted.theta, selection.horizon_s, grounds.windows.noise)
        replays += replay_runs(model, windows, fitted.theta, held_out)
    return FittedModel(
        model,
        fitted.theta,
        covariance,
        estimates(fitted, covariance, blocks.count, flat),
        tuple(effect.key for effect in model.effects),
        tuple(replays),
    )


def _remainder(final: Grounds, after: dict[str, float], units: dict[str, str], selection: Selection) -> Remainder:
    if max(after.values(), default=0.0) <= selection.tolerance:
        return Remainder("noise", after, "")
    worst = failures(final.fitted, final.windows, units, most=1)
    return Remainder("structured", after, worst[0].where if worst else "")


def _silent(line: str) -> None:
    del line
