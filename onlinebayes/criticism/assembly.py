"""The answer put together: what the fit runs say, the held-out runs opened once, and what a reader should know.

found in the fit runs -> verdict -> both models replayed over all runs -> error over the held-out runs -> notes
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch

from onlinebayes.criticism.findings.answers import parameter_changes, widened_bounds, wiring_of
from onlinebayes.criticism.findings.carried_over import errors_on_the_way, in_vain_note, worse_runs_note
from onlinebayes.criticism.findings.fit_notes import fit_notes
from onlinebayes.criticism.findings.gear_notes import gear_notes
from onlinebayes.criticism.findings.held_out_evaluation import evaluate_held_out
from onlinebayes.criticism.findings.log_notes import log_notes
from onlinebayes.criticism.findings.new_ground import new_ground_notes, reaches
from onlinebayes.criticism.findings.ranking import rank, steps
from onlinebayes.criticism.findings.reading_notes import gap_notes, start_notes, tie_notes
from onlinebayes.criticism.findings.too_small import too_small_note
from onlinebayes.criticism.judging.held_starts import fitted_starts, starts_note
from onlinebayes.criticism.judging.localise import failures
from onlinebayes.criticism.judging.verdict import Evidence, decide, left_over, what_to_record
from onlinebayes.criticism.results import Candidate, Criticism, HeldOutError, Question, Remainder
from onlinebayes.criticism.searching.search import SearchResult
from onlinebayes.criticism.searching.stage import blocks_for
from onlinebayes.criticism.searching.ties import alternatives
from onlinebayes.criticism.task import Task
from onlinebayes.criticism.timing import Stopwatch
from onlinebayes.criticism.wiring.wiring import Suspicion
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.detail import Detail
from onlinebayes.identification.fitting.blocks import Blocks
from onlinebayes.identification.fitting.fit import residual_correlation_time
from onlinebayes.identification.fitting.heldout import replay_runs
from onlinebayes.identification.fitting.identifiability import covariance_of, estimates, flat_directions
from onlinebayes.identification.fitting.numerics import Grounds
from onlinebayes.identification.replaying.ladder import Rung, reported
from onlinebayes.identification.replaying.measured_starts import windows_to_replay
from onlinebayes.identification.results import FittedModel, FlatDirection, ReplayedRun


@dataclass(frozen=True)
class _Opened:
    """Both models replayed over all runs, and the error over the held-out ones.

    Args:
        base, final: the base model and the accepted one (the same object where nothing was accepted).
        rung: by which both are run.
        held: windows of the held-out runs at every row.
        error, detail: of both models over them.
        fitted_starts: what the final model leaves there with starts fitted, where the measured ones are what errs.
    """

    base: FittedModel
    final: FittedModel
    rung: Rung
    held: Windows
    error: HeldOutError
    detail: Detail
    fitted_starts: dict[str, float]


def assemble(
    question: Question, task: Task, found: SearchResult, fault: Suspicion | None, stopwatch: Stopwatch
) -> Criticism:
    """The answer to a question.

    Args:
        question: which command asks.
        task: the model and the runs.
        found: what the search found in the fit runs.
        fault: the wiring fault that explains more, if one does.
        stopwatch: takes the stages, and has timed the earlier ones.
    """
    simulator, selection, base, final = task.simulator, task.selection, found.base, found.final
    units = {signal.name: signal.unit for signal in task.fit_runs.signals}
    signals = tuple(units)
    blocks = blocks_for(base.fitted, base.windows, selection.folds)
    stopwatch("comparing with its equals" if found.accepted else "weighing what is left")
    equal = alternatives(found.simulator(simulator), found, selection.folds)
    evidence = _evidence(question, task, found, fault, equal)
    verdict = decide(evidence, selection.tolerance)
    stopwatch("opening the held-out runs")
    models = _opened(task, found, blocks, units)
    candidates = rank(found, equal, models.final.parameters)
    return Criticism(
        command=question,
        verdict=verdict,
        accepted=tuple(judged.effect.key for _, judged in found.accepted),
        remainder=_remainder(final, evidence.after, units, selection.tolerance),
        heldout_error=models.error,
        steps=steps(found),
        candidates=candidates,
        candidates_tried=len(found.effects),
        holdout_looks=1,
        failures=failures(base.fitted, base.windows, units),
        parameters=models.final.parameters,
        flat_directions=_flat(final),
        numerics=final.numerics,
        base=models.base,
        final=models.final,
        signals=signals,
        commands=tuple(simulator.commands),
        units=units,
        sensor_sd=dict(zip(signals, base.windows.noise.tolist(), strict=True)),
        selection=selection,
        what_to_record=_what_to_record(base, blocks) if verdict == "insufficient_data" else "",
        interrupted=found.interrupted,
        notes=_notes(question, task, found, fault, models, candidates, units),
        widened=widened_bounds(found, models.final.parameters),
        detail=models.detail,
        timings=stopwatch.timings(),
        wiring=None if fault is None else wiring_of(fault),
        changes=parameter_changes(found, models.final.parameters),
        mended=_mended(fault, task) if fault is not None and verdict == "data_problem" else None,
        fitted_starts=models.fitted_starts,
    )


def _evidence(
    question: Question, task: Task, found: SearchResult, fault: Suspicion | None, equal: Mapping[str, tuple[str, ...]]
) -> Evidence:
    """What the verdict rests on."""
    before, after = (left_over(grounds) for grounds in (found.base, found.final))
    return Evidence(
        enough=found.enough,
        undecided=found.undecided,
        numerics=found.base.numerics,
        accepted=len(found.accepted),
        tie=bool(found.accepted and equal[found.accepted[0][1].effect.key]),
        bounds=found.widened is not None,
        before=before,
        after=after,
        miswired=fault is not None and (fault.certain or question != "compare"),
        changed=bool(found.changes),
    )


def _opened(task: Task, found: SearchResult, blocks: Blocks, units: dict[str, str]) -> _Opened:
    """The held-out runs opened; ``blocks`` are the base model's."""
    base, final, horizon = found.base, found.final, task.selection.horizon_s
    # One step for both models: rows are cut to whole steps, and the two replays are shown row beside row.
    rung = reported(task.simulator, base.fitted.simulator, final.fitted.simulator)
    base_model = final_model = _model(base, rung, blocks, task)
    if final is not base:
        final_model = _model(final, rung, blocks_for(final.fitted, final.windows, task.selection.folds), task)
    held = windows_to_replay(final_model.simulator, task.held_runs, final_model.theta, horizon, final.windows.noise)
    error, detail = evaluate_held_out(base_model, final_model, held, tuple(units), units)
    left = fitted_starts(final_model, held, error, task.selection.tolerance)
    return _Opened(base_model, final_model, rung, held, error, detail, left)


def _model(grounds: Grounds, rung: Rung, blocks: Blocks, task: Task) -> FittedModel:
    """The fitted model run by ``rung``, with its replays at every row."""
    fitted = _fitted(grounds, rung, blocks)
    replays: list[ReplayedRun] = []
    for runs, held_out in ((task.fit_runs, False), (task.held_runs, True)):
        horizon, noise = task.selection.horizon_s, grounds.windows.noise
        windows = windows_to_replay(fitted.simulator, runs, fitted.theta, horizon, noise)
        replays += replay_runs(fitted.simulator, windows, fitted.theta, held_out)
    return replace(fitted, replays=tuple(replays))


def _fitted(grounds: Grounds, rung: Rung, blocks: Blocks) -> FittedModel:
    """The fitted model run by ``rung``, without replays."""
    fitted = grounds.fitted
    model = rung.of(fitted.simulator)
    covariance = covariance_of(fitted, blocks) + torch.outer(grounds.shift, grounds.shift)
    values = estimates(fitted, covariance, blocks.count, _flat(grounds))
    return FittedModel(model, fitted.theta, covariance, values, tuple(effect.key for effect in model.effects), ())


def _mended(fault: Suspicion, task: Task) -> FittedModel:
    """The base model fitted to the mended table."""
    grounds = fault.grounds
    return _fitted(
        grounds,
        reported(task.simulator, grounds.fitted.simulator),
        blocks_for(grounds.fitted, grounds.windows, task.selection.folds),
    )


def _flat(grounds: Grounds) -> tuple[FlatDirection, ...]:
    """The combinations of parameters that the fit runs do not determine."""
    correlation = residual_correlation_time(grounds.fitted, grounds.windows)
    return flat_directions(grounds.fitted, correlation, grounds.windows.bin_step)


def _remainder(final: Grounds, after: Mapping[str, float], units: dict[str, str], tolerance: float) -> Remainder:
    """What the final model leaves, and where."""
    if max(after.values(), default=0.0) <= tolerance:
        return Remainder("noise", after, "")
    worst = failures(final.fitted, final.windows, units, most=1)
    return Remainder("structured", after, worst[0].where if worst else "")


def _what_to_record(base: Grounds, blocks: Blocks) -> str:
    """What would decide; see :func:`.judging.verdict.what_to_record`."""
    moves = bool(base.windows.observed.any())
    return what_to_record(blocks.count, moves, base.windows, residual_correlation_time(base.fitted, base.windows))


def _notes(
    question: Question,
    task: Task,
    found: SearchResult,
    fault: Suspicion | None,
    models: _Opened,
    candidates: tuple[Candidate, ...],
    units: dict[str, str],
) -> tuple[str, ...]:
    """What else a reader should know: of the task, the fit, the held-out runs and the log."""
    parameters, simulator = models.final.parameters, task.simulator
    # Starts that were taken as measured explain a held-out error, wherever else its runs went.
    beyond_fit = starts_note(models.fitted_starts, models.error) or new_ground_notes(
        models.final.replays,
        reaches(found.final.windows, simulator.commands),
        reaches(models.held, simulator.commands),
        models.error.noise_floor,
        units,
    )
    return (
        *task.notes,
        *tie_notes(simulator, task.otherwise_tied),
        *gap_notes(task.fit_runs),
        *start_notes(task.fit_runs, models.final.simulator),
        *fit_notes(
            simulator, found, task.selection, parameters, miswired=fault is not None, refined=question == "refine"
        ),
        *(_carried_over(task, found, models, units) if found.accepted else ()),
        *beyond_fit,
        *too_small_note(candidates, task.selection.alpha),
        *gear_notes(models.final, candidates),
        *log_notes(candidates, parameters, simulator.commands, tuple(units)),
    )


def _carried_over(task: Task, found: SearchResult, models: _Opened, units: dict[str, str]) -> tuple[str, ...]:
    """Notes on what was accepted and does not hold in the held-out runs."""
    on_the_way = errors_on_the_way(found.accepted, models.rung, task.held_runs, task.selection.horizon_s)
    last = found.accepted[-1][1].effect.key
    in_vain = in_vain_note(models.error.before, on_the_way, last, models.error.after, units)
    return (*worse_runs_note(models.detail.windows, units, models.error.noise_floor), *in_vain)
