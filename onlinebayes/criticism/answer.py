"""The answer put together: what the fit runs say, what the held-out runs leave of it, and what a reader should know.

found in the fit runs -> verdict -> both models replayed over all runs -> error over the held-out runs
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from onlinebayes.criticism.criticism import Criticism
from onlinebayes.criticism.findings.contradicted import Uncontradicted, uncontradicted
from onlinebayes.criticism.findings.delays import ahead_of_commands, located_delays
from onlinebayes.criticism.findings.doubts import doubts
from onlinebayes.criticism.findings.file_error import error_of_file
from onlinebayes.criticism.findings.fleets import fleets_of
from onlinebayes.criticism.findings.held_out_evaluation import evaluate_held_out
from onlinebayes.criticism.findings.localise import failures
from onlinebayes.criticism.findings.named import names_said, with_probabilities
from onlinebayes.criticism.findings.notes import notes_on, weights
from onlinebayes.criticism.findings.remainder import rms_over_floor
from onlinebayes.criticism.findings.undetermined import determined
from onlinebayes.criticism.findings.values_per_run import parameter_changes
from onlinebayes.criticism.hypotheses.additions import FreedNumber, WiderBounds
from onlinebayes.criticism.hypotheses.explanation import Explanation
from onlinebayes.criticism.hypotheses.kept_fit import keep_fits
from onlinebayes.criticism.hypotheses.models import fitted_model, flat_of, numerics_of
from onlinebayes.criticism.hypotheses.ranking import laws, ranked, steps
from onlinebayes.criticism.hypotheses.verdict import decide, what_to_record
from onlinebayes.criticism.hypotheses.weighing import weighted
from onlinebayes.criticism.log_faults import LEAST_FLOORS, CorrectedLog
from onlinebayes.criticism.prepared_log import PreparedLog
from onlinebayes.criticism.results import (
    CONTRADICTED,
    UNDETERMINED,
    Candidate,
    HeldOutError,
    LocatedDelay,
    Question,
    Remainder,
    Verdict,
    WeightedModel,
    WidenedBounds,
    Wiring,
)
from onlinebayes.criticism.timing import Stopwatch
from onlinebayes.criticism.wiring.dead_commands import accused, dead_commands
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.detail import Detail
from onlinebayes.identification.fitting.fit import Fit, weighed_by_noise
from onlinebayes.identification.judging.evaluator import AT_FLOOR, Evaluation, Evaluator
from onlinebayes.identification.judging.hypothesis import build
from onlinebayes.identification.replaying.integration import Integration, reported
from onlinebayes.identification.replaying.measured_starts import windows_to_replay
from onlinebayes.identification.results import FittedModel
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import Parameter
from onlinebayes.runs import Attempts
from onlinebayes.simulators.identifiable import Identifiable


def answered(
    question: Question,
    task: PreparedLog,
    explanation: Explanation,
    fault: CorrectedLog | None,
    stopwatch: Stopwatch,
    attempts: Attempts,
) -> Criticism:
    """The answer to a question.

    Args:
        question: which command asks.
        task: the model and the runs.
        explanation: what was found in the fit runs.
        fault: what is wrong with the log, if that explains as much: nothing is added to the model then.
        stopwatch: takes the stages, and has timed the earlier ones.
        attempts: takes what fails of all that an answer can do without.
    """
    units, made = {signal.name: signal.unit for signal in task.fit_runs.signals}, attempts.made
    explanation = explanation if fault is None else replace(explanation, found=explanation.base)
    nothing_gone: tuple[Explanation, tuple[str, ...]] = (explanation, ())
    explanation, undetermined = made(
        "asking what may be nothing", lambda: determined(explanation, task.selection.folds), nothing_gone
    )
    stopwatch("asking the held-out runs what to keep")
    asked_held = made(
        "asking the held-out runs what to keep",
        lambda: uncontradicted(explanation, task.held_runs, task.selection.horizon_s),
        Uncontradicted(explanation),
    )
    explanation, contradicted = asked_held.explanation, asked_held.gone
    base, found, evaluator = explanation.base, explanation.found, explanation.evaluator
    stopwatch("weighing what is left")
    windows = explanation.windows
    base_fit, fit = (weighed_by_noise(one.fitted, windows) for one in (base, found))
    numerics = numerics_of(found, evaluator)
    before, after = (rms_over_floor(one, windows, numerics) for one in (base_fit, fit))
    asked = what_to_record(windows, task.fit_runs, task.selection.horizon_s)
    stopwatch("opening the held-out runs")
    base_model, final_model, held = _opened(task, explanation, (base_fit, fit), attempts)
    error, detail = _held_out(base_model, final_model, held, units, attempts)
    no_error: Mapping[str, float] = {}
    file_error = no_error
    if question == "refine" and fault is None:
        file_error = made("the error of refined.xml", lambda: error_of_file(final_model, held, error.after), no_error)
    alone: tuple[WeightedModel, ...] = (WeightedModel(1.0, laws(found.hypothesis), final_model),)
    hypotheses = made("weighing the models", lambda: _hypotheses(explanation, task, final_model), alone)
    if fault is None and explanation.explains:
        made("keeping what was fitted", lambda: keep_fits(explanation, task.fit_runs), None)
    verdict: Verdict = "data_problem"
    doubted: tuple[str, ...] = ()
    said: tuple[str, ...] = ()
    if fault is None:
        doubted = made("doubting what was found", lambda: tuple(doubts(explanation, asked_held.gain)), ())
        verdict = decide(
            explanation, numerics, before, after, task.selection.tolerance, enough=not asked, doubted=bool(doubted)
        )
        beliefs = weights(hypotheses) if verdict == "tie" else ()
        said = made("the notes", lambda: (*notes_on(explanation, numerics, final_model.parameters), *beliefs), ())
        errs = tuple(name for name, left in after.items() if left > LEAST_FLOORS)
        dead = dead_commands(task.fit_runs) if errs else {}
        doubted = (*doubted, *([accused(dead, errs)] if dead else ()))
    gone = dict.fromkeys(undetermined, UNDETERMINED) | dict.fromkeys(contradicted, CONTRADICTED)
    candidates: tuple[Candidate, ...] = made(
        "ranking the candidates", lambda: ranked(explanation, final_model.parameters, gone), ()
    )
    left = max(after.values(), default=math.inf)
    candidates = made(
        "the probabilities of names",
        lambda: with_probabilities(candidates, names_said(explanation, left, final_model.parameters)),
        candidates,
    )
    no_delays: tuple[LocatedDelay, ...] = ()
    delays = made(
        "looking where the delay is",
        lambda: (
            located_delays(explanation, final_model.parameters) if fault is None else ahead_of_commands(fault.fault)
        ),
        no_delays,
    )
    corrected = None if fault is None else made("the corrected table", lambda: _corrected(fault, task), None)
    nothing = Remainder("structured", after, "")
    return Criticism(
        command=question,
        verdict=verdict,
        what_to_record=asked if fault is None else "",
        accepted=laws(found.hypothesis),
        remainder=made(
            "looking at what is left",
            lambda: _remainder(fit, explanation, after, units, task.selection.tolerance),
            nothing,
        ),
        heldout_error=error,
        file_error=file_error,
        steps=made("the steps of the search", lambda: steps(explanation), ()),
        candidates=candidates,
        candidates_tried=len(candidates),
        holdout_looks=1 + len(contradicted),
        failures=made("looking where the model fails", lambda: failures(base_fit, windows, units), ()),
        parameters=final_model.parameters,
        flat_directions=made("looking for what the data do not determine", lambda: flat_of(fit, windows), ()),
        numerics=numerics,
        base=base_model,
        final=final_model,
        signals=tuple(units),
        commands=tuple(task.simulator.commands),
        units=units,
        sensor_sd=dict(zip(units, windows.noise.tolist(), strict=True)),
        selection=task.selection,
        notes=(*doubted, *map(_worse, contradicted), *map(_nothing, undetermined), *task.notes, *said),
        fleet=made("what the units have in common", lambda: fleets_of(final_model), {}) if fault is None else {},
        contradicted=contradicted,
        held_out_gain=asked_held.gain,
        widened=made("the bounds that exclude the truth", lambda: _widened(found), {}),
        detail=detail,
        timings=stopwatch.timings(),
        changes=made("what differs between runs", lambda: parameter_changes(explanation, final_model.parameters), ()),
        wiring=None if fault is None else _wiring(fault, base),
        corrected=corrected,
        read_as="\n".join(filter(None, (reading.lines for reading in task.readings))),
        hypotheses=hypotheses,
        delays=delays,
        given=task.given,
        integration=_shown(evaluator, task.simulator, base, found),
        explanation=explanation,
    )


def _nothing(key: str) -> str:
    return f"{key} was added and may be nothing, its interval says: it is not in the model"


def _worse(key: str) -> str:
    return f"{key} fits the runs that it was fitted to and makes the held-out runs worse: it is not in the model"


def _wiring(fault: CorrectedLog, base: Evaluation) -> Wiring:
    """The fault in words, and what mends it."""
    before, after = (float(one.left_out[0].rms.square().mean().sqrt()) for one in (base, fault.evaluation))
    alternatives = tuple((other.says, other.lines) for other in fault.equals)
    return Wiring(fault.fault.says, fault.fault.lines, before, after, alternatives)


def _corrected(fault: CorrectedLog, task: PreparedLog) -> FittedModel:
    """The base model fitted to the table put right, without replays."""
    evaluation, evaluator = fault.evaluation, fault.evaluator
    way = _shown(evaluator, evaluator.given, evaluation)
    return fitted_model(evaluation, evaluator, task.selection.folds, way, ())


def _hypotheses(explanation: Explanation, task: PreparedLog, final: FittedModel) -> tuple[WeightedModel, ...]:
    """The final model, and those that the data cannot tell from it."""
    evaluator, (found, *others) = explanation.evaluator, weighted(explanation)
    models = [
        fitted_model(
            one.evaluation, evaluator, task.selection.folds, _shown(evaluator, task.simulator, one.evaluation), ()
        )
        for one in others
    ]
    return tuple(
        WeightedModel(one.weight, laws(one.evaluation.hypothesis), model)
        for one, model in zip((found, *others), (final, *models), strict=True)
    )


def _opened(
    task: PreparedLog, explanation: Explanation, fits: tuple[Fit, Fit], attempts: Attempts
) -> tuple[FittedModel, FittedModel, Windows | None]:
    """Both models, with their fits, replayed over all runs in the same windows, and those of the held-out runs.

    Runs that cannot be replayed are left out.
    """
    evaluator, selection, base, found = explanation.evaluator, task.selection, explanation.base, explanation.found
    way = _shown(evaluator, task.simulator, base, found)
    shown = way.of(build(evaluator.given, found.hypothesis, evaluator.runs))

    def windows(runs: Measurement) -> Windows:
        return windows_to_replay(shown, runs, found.fitted.theta, selection.horizon_s, explanation.windows.noise)

    def models(*parts: tuple[Windows, bool]) -> tuple[FittedModel, FittedModel]:
        before = fitted_model(base, evaluator, selection.folds, way, parts, fits[0])
        if found is base:
            return before, before
        return before, fitted_model(found, evaluator, selection.folds, way, parts, fits[1])

    with attempts.attempt("replaying all runs"):
        held = windows(task.held_runs)
        return *models((windows(task.fit_runs), False), (held, True)), held
    with attempts.attempt("replaying the fit runs"):
        return *models((windows(task.fit_runs), False)), None
    return *models(), None


def _held_out(
    base: FittedModel, final: FittedModel, held: Windows | None, units: dict[str, str], attempts: Attempts
) -> tuple[HeldOutError, Detail]:
    """Error over the held-out runs and its detail; not a number where these could not be replayed."""
    if held is not None:
        with attempts.attempt("the error over the held-out runs"):
            return evaluate_held_out(base, final, held, tuple(units), units)
    unknown = dict.fromkeys(units, math.nan)
    return HeldOutError(unknown, unknown, unknown, unknown), Detail()


def _shown(evaluator: Evaluator, given: Identifiable, *evaluations: Evaluation) -> Integration:
    """Choose the integration of the reported models: no coarser than the user's, unless the log follows just that."""
    way = evaluator.discretisation.values
    if evaluator.original_integrator and not way.scaled_moments:
        return way
    chosen = reported(given, *(evaluation.fitted.simulator for evaluation in evaluations))
    return replace(chosen, scaled_moments=way.scaled_moments)


def _remainder(
    fit: Fit, explanation: Explanation, after: Mapping[str, float], units: dict[str, str], tolerance: float
) -> Remainder:
    """Return the error that the final model leaves, and where."""
    if max(after.values(), default=0.0) <= max(tolerance, AT_FLOOR):
        return Remainder("noise", after, "")
    worst = failures(fit, explanation.windows, units, most=1)
    return Remainder("structured", after, worst[0].where if worst else "")


def _widened(found: Evaluation) -> dict[str, WidenedBounds]:
    """Bounds that exclude the truth and numbers that are off, as they are and as they were in the fit."""
    wide, space = dict[str, WidenedBounds](), found.fitted.simulator.parameters
    for addition in found.hypothesis.additions:
        if isinstance(addition, FreedNumber):
            own = float(found.fitted.simulator.nominal[space.index(addition.address)])
            wide[addition.address] = WidenedBounds((own, own), _ends(space[addition.address]))
        elif isinstance(addition, WiderBounds):
            for one in addition.ranges:
                before = (one.before.low, one.before.high)
                wide.setdefault(one.name, WidenedBounds(before, _ends(space[one.name])))
    return wide


def _ends(bounds: Parameter) -> tuple[float, float]:
    return float(f"{bounds.low:.4g}"), float(f"{bounds.high:.4g}")
