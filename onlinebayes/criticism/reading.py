"""The base model fitted to the runs, and the runs read as it follows them best: see :mod:`.wiring.readings`.

A reading that parts the runs anew is compared over the stretches that are left, in which the log is held against the
model read both ways, value by value: what it leaves out speaks neither for it nor against it. It has to explain half of
the misfit: a model that answers a little late follows any log better with commands that come a little earlier.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from onlinebayes.criticism.hypotheses.explanation import start_search
from onlinebayes.criticism.hypotheses.search import Search
from onlinebayes.criticism.log_faults import LEAST_FLOORS, MOVING, judged
from onlinebayes.criticism.prepared_log import PreparedLog
from onlinebayes.criticism.wiring.readings import Reading
from onlinebayes.criticism.wiring.shifts import shifts
from onlinebayes.identification.data.windows import Windows, make_windows
from onlinebayes.identification.fitting.discretisation import Discretisation
from onlinebayes.identification.fitting.window_length import FEW, thinned
from onlinebayes.identification.judging.evaluator import FIRST_STEPS, Evaluation, Evaluator, FitRequest
from onlinebayes.identification.judging.rule import LEAST_GAIN, explains_half, preferred
from onlinebayes.identification.judging.scoring import Gain
from onlinebayes.identification.replaying.integration import Integration
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput, Memo, Stopped, Watch, side_by_side


def begun_as_read(task: PreparedLog, watch: Watch, memo: Memo | None = None) -> tuple[PreparedLog, Search]:
    """The task as its base model asks it to be read, and a search that stands at that model.

    Args:
        task: read as it is where nothing asks for more.
        watch: told what is being done.
        memo: keeps fits for the next command.

    Raises:
        BadInput: the model cannot follow the measurement.
        Stopped: it was interrupted.
    """
    search = start_search(task.simulator, task.fit_runs, watch, memo)
    with watch.heeded():
        while (other := better_read(task, search, search.base)) is not None:
            task, search = other, start_search(other.simulator, other.fit_runs, watch, memo)
    return task, search


def better_read(task: PreparedLog, search: Search, here: Evaluation) -> PreparedLog | None:
    """The task in the first other reading that the rule prefers; None without.

    Args:
        task: as it is read.
        search: whose evaluator fitted the model.
        here: the model that is asked.
    """
    nothing_yet = here.gains(here)[0]
    readings = list(task.other_readings(here.fitted.simulator))
    if not readings:
        return None
    search.evaluator.watch("reading the log otherwise")
    found = side_by_side([partial(_gained, one, search.evaluator, here, task.fit_runs) for one in readings])
    preferable = (one for one, gains in zip(readings, found, strict=True) if gains and preferred(gains, nothing_yet))
    first = next(preferable, None)
    return None if first is None else task.read(first)


def _gained(reading: Reading, evaluator: Evaluator, here: Evaluation, runs: Measurement) -> Sequence[Gain] | None:
    """Return what a reading gains, for each way of leaving data out; None where it cannot be followed."""
    if reading.parts_runs:
        return _gained_in_stretches(reading, evaluator, here, runs)
    found = judged(reading, evaluator, here, runs)
    return None if found is None else found.gains


def _gained_in_stretches(
    reading: Reading, evaluator: Evaluator, here: Evaluation, runs: Measurement
) -> Sequence[Gain] | None:
    """Return the same of a reading that parts runs; None, too, where it leaves few of them, or explains too little."""
    if float(here.left_out[0].rms.max()) <= LEAST_FLOORS:
        return None
    try:
        windows, stood = _stretches(reading, evaluator, runs)
    except Stopped:
        raise
    except BadInput:
        return None
    few = min(FEW / evaluator.windows.count, 1.0)
    if windows.observed.sum() <= MOVING * few * evaluator.windows.observed.sum():
        return None
    anew = replace(evaluator, windows=windows, parted=windows, discretisation=_within(evaluator, windows.step))
    old = anew.of_table(evaluator.given, stood)
    asked = FitRequest(here.hypothesis, [here.values, {}], most=FIRST_STEPS)
    curved, held = (one.evaluate(replace(asked, most=0)) for one in (anew, old))
    if curved is None or held is None or curved.gains(held)[0].gain < LEAST_GAIN:
        return None
    # The stretches leave out what is hardest to follow: what is worse over them than over all explains nothing.
    found = anew.evaluate(replace(asked, wanted=here.fitted.score))
    before = None if found is None else old.evaluate(asked)
    if found is None or before is None or not explains_half(before.left_out[0], found.left_out[0]):
        return None
    return None if _better_shifted(found, evaluator, here, runs) else found.gains(before)


def _better_shifted(found: Evaluation, evaluator: Evaluator, here: Evaluation, runs: Measurement) -> bool:
    """Check whether signals that run ahead of the commands leave less: half a row is half of what they lie apart."""
    ahead = next((one for one in shifts(runs, commanded=True, late=False) if one.every), None)
    rival = None if ahead is None else judged(ahead, evaluator, here, runs)
    if rival is None or not explains_half(here.left_out[0], rival.evaluation.left_out[0]):
        return False
    return float(rival.evaluation.left_out[0].rms.max()) < float(found.left_out[0].rms.max())


def _stretches(reading: Reading, evaluator: Evaluator, runs: Measurement) -> tuple[Windows, Windows]:
    """The windows of the runs read otherwise, and the same as the runs are read, with the same values to follow."""
    known = evaluator.windows
    memory = known.history.shape[1] * known.step
    every = make_windows(evaluator.given, reading.correct(runs), known.horizon, memory, known.noise)
    windows = thinned(every, min(FEW, known.count))
    stood = make_windows(evaluator.given, runs, known.horizon, memory, like=windows)
    return windows, replace(stood, observed=stood.observed & windows.observed)


def _within(evaluator: Evaluator, row: float) -> Discretisation:
    """The evaluator's ways to integrate, in steps that divide a row [s]."""

    def dividing(way: Integration) -> Integration:
        parts = row / way.timestep
        whole = parts > 0.5 and abs(parts - round(parts)) < 1e-6
        return way if whole else replace(way, timestep=min(row, evaluator.given.timestep))

    ways = evaluator.discretisation
    return Discretisation(dividing(ways.values), dividing(ways.derivatives))
