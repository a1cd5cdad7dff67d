"""Is it the log: does a reversed sign, a wrong unit, a swapped column explain the misfit better than any law?

    gain(fault) = gain in left-out score of the model fitted to the table put right

Which faults are fitted says :mod:`.promising_faults`.

A fault has no parameter of its own, so that it goes before every law that does no better. It has to take away half of
the squared error above the noise: it is gross, or it is none. Errors are counted in units of a floor that carries the
fault's factor along: dividing a column by 57 makes no error smaller. Nor does a fault explain what it stills: a column
in thousandths moves by less than its sensor's noise, and would not be scored. Windows that a fault leaves without a
measured value are left out of both scores.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

from onlinebayes.criticism.hypotheses.explanation import start_search
from onlinebayes.criticism.promising_faults import in_both, promising_faults, put_right, rows_over
from onlinebayes.criticism.wiring.faults import Fault
from onlinebayes.criticism.wiring.outages import Sighting, sighted
from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.fitting.gauss_newton import score_of
from onlinebayes.identification.judging.evaluator import AT_FLOOR, FIRST_STEPS, Evaluation, Evaluator, FitRequest
from onlinebayes.identification.judging.rule import LEAST_GAIN, equally_good, explains_half
from onlinebayes.identification.judging.scoring import Gain
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput, Stopped, side_by_side

LEAST_FLOORS = 3.0
"""A base model that errs by fewer floors has no such fault."""

OUTAGE_WINDOWS = (0.25, 1.0)
"""Seconds of the windows in which outages are looked for. Those of the fit, of the first length at least, show edges
best; in the second, parameters that suit the rest fail long enough to be seen. What explains more is judged."""

MOVING = 0.5
"""Of what is scored in the table as it stands: a mended one in which no more moves is a stilled one."""


@dataclass(frozen=True, eq=False)
class CorrectedLog:
    """A fault that explains the misfit.

    Args:
        fault: what it is.
        equals: faults that explain as much.
        evaluator, evaluation: the model fitted to the table put right.
        gains: over the model fitted to the table as it stands, for each way of leaving data out.
    """

    fault: Fault
    equals: tuple[Fault, ...]
    evaluator: Evaluator
    evaluation: Evaluation
    gains: tuple[Gain, ...]

    @property
    def certain(self) -> bool:
        """True if nothing but noise is left: no law can explain as much with less."""
        return float(self.evaluation.left_out[0].rms.max()) <= AT_FLOOR

    def as_good_as(self, found: Evaluation, base: Evaluation) -> bool:
        """Check whether it explains at least as much as what the search found, or cannot be told from it."""
        theirs = found.gains(base)
        over = [
            Gain(tuple(b - a for a, b in zip(mine.by_signal, other.by_signal, strict=True)), other.se, other.folds, 0)
            for mine, other in zip(self.gains, theirs, strict=True)
        ]
        return equally_good(over, [one.gain for one in theirs])


def find_fault(
    evaluator: Evaluator, base: Evaluation, measurement: Measurement, laws: bool = True
) -> CorrectedLog | None:
    """The fault of signs, units, columns or zeros that explains the misfit of the base model, if one does.

    Args:
        evaluator, base: the base model fitted to the table as it stands.
        measurement: the fit runs.
        laws: whether laws are tried, too; where none is, columns that are late are looked for.
    """
    if float(base.left_out[0].rms.max()) <= LEAST_FLOORS:
        return None
    evaluator.watch("checking signs, units and columns")
    promising = promising_faults(evaluator, base, measurement, laws)
    tried = side_by_side([partial(_explaining, fault, evaluator, base, measurement) for fault in promising])
    return _best([one for one in tried if one is not None], evaluator, measurement)


def switched_off(evaluator: Evaluator, base: Evaluation, measurement: Measurement) -> CorrectedLog | None:
    """The actuators that were off for parts of runs, if that explains the misfit of the base model.

    It costs as much as a search: it is asked where no law leaves noise. Arguments as :func:`find_fault`.
    """
    if float(base.left_out[0].rms.max()) <= LEAST_FLOORS:
        return None
    evaluator.watch("checking whether an actuator was off")
    faults = [seen.settled for seen in _sightings(evaluator, base, measurement)]
    asked = [partial(_explaining, fault, evaluator, base, measurement) for fault in faults if fault is not None]
    tried = side_by_side(asked)
    most = max(filter(None, tried), key=lambda one: one.gains[0].gain, default=None)
    return None if most is None else _best([most], evaluator, measurement)


def _best(enough: Sequence[CorrectedLog], evaluator: Evaluator, measurement: Measurement) -> CorrectedLog | None:
    """The simplest of those that explain most, with the others that do as well."""
    if not enough:
        return None
    best = max(enough, key=lambda one: one.gains[0].gain)
    alike = [one for one in enough if one is best or equally_good(best.evaluation.gains(one.evaluation), _gains(best))]
    return _anew(replace(alike[0], equals=tuple(one.fault for one in alike[1:])), evaluator, measurement)


def _anew(found: CorrectedLog, evaluator: Evaluator, measurement: Measurement) -> CorrectedLog:
    """The same with the model fitted on windows and in steps that suit the table put right."""
    search = start_search(found.fault.model(evaluator.given), found.fault.correct(measurement), memo=evaluator.memo)
    base = search.refined(search.base)
    return replace(found, evaluator=search.evaluator, evaluation=base)


def _gains(found: CorrectedLog) -> list[float]:
    return [one.gain for one in found.gains]


def _explaining(fault: Fault, evaluator: Evaluator, base: Evaluation, measurement: Measurement) -> CorrectedLog | None:
    """A fault that explains half of the misfit; the tables of others are not kept, for a long log fills the memory."""
    found = judged(fault, evaluator, base, measurement)
    explains = found is not None and explains_half(base.left_out[0], found.evaluation.left_out[0])
    return found if explains else None


def judged(fault: Fault, evaluator: Evaluator, here: Evaluation, measurement: Measurement) -> CorrectedLog | None:
    """A model fitted to the table put right; None where that stills what moved, or cannot be followed.

    It is judged over the windows that both tables have: what a fault takes away speaks neither for it nor against it.

    Args:
        fault: what is put right.
        evaluator, here: a hypothesis fitted to the table as it stands.
        measurement: the fit runs.
    """
    try:
        given = fault.model(evaluator.given)
        windows, stood = in_both(put_right(fault, given, evaluator.windows, measurement), evaluator.windows)
    except Stopped:
        raise
    except BadInput:
        return None
    if min(windows.observed.sum(), stood.observed.sum()) <= MOVING * evaluator.windows.observed.sum():
        return None  # of two faults that pass, each has more than half: they share a window
    anew = evaluator.of_table(given, windows)
    rows = rows_over(stood, here, evaluator.windows)
    wanted = score_of(stood, rows.in_noise(rows.residual)) - LEAST_GAIN
    found = anew.evaluate(FitRequest(here.hypothesis, [here.values, {}], most=FIRST_STEPS, wanted=wanted))
    if found is not None and found.gains(here)[0].gain >= LEAST_GAIN:
        found = anew.anew(found)  # what gains nothing by then is no fault
    return None if found is None else CorrectedLog(fault, (), anew, found, found.gains(here))


def _sightings(evaluator: Evaluator, base: Evaluation, measurement: Measurement) -> Iterator[Sighting]:
    """Actuators that were off for parts of runs, where few windows err far more than the others, by window length."""
    if not evaluator.given.commands:
        return
    windows, way = evaluator.windows, evaluator.discretisation.values
    simulator = way.of(evaluator.given)
    shortest, long = OUTAGE_WINDOWS
    for horizon in dict.fromkeys((max(shortest, windows.horizon), long)):
        try:
            found = sighted(
                base.fitted.theta, simulator, make_windows(simulator, measurement, horizon, 0.0, windows.noise)
            )
        except Stopped:
            raise
        except BadInput:
            continue
        if found is not None:
            yield found
