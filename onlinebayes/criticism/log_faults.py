"""Is it the log: does a reversed sign, a wrong unit, a swapped column explain the misfit better than any law?

    promise(fault) = score of the replay from the smoothed starts - the same with the fault put right      screened
    gain(fault)    = gain in left-out score of the model fitted to the table put right                     judged

A fault has no parameter of its own, so that it goes before every law that does no better. It has to take away half of
the squared error above the noise: it is gross, or it is none. Errors are counted in units of a floor that carries the
fault's factor along: dividing a column by 57 makes no error smaller. Nor does a fault explain what it stills: a column
in thousandths moves by less than its sensor's noise, and would not be scored. Windows that a fault leaves without a
measured value are left out of both scores.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.criticism.hypotheses.explanation import start_search
from onlinebayes.criticism.wiring.faults import AsItStands, Fault
from onlinebayes.criticism.wiring.outages import Sighting, sighted
from onlinebayes.criticism.wiring.possible import possible_faults
from onlinebayes.identification.data.motion import seen_by
from onlinebayes.identification.data.windows import Windows, joint_names, make_windows
from onlinebayes.identification.fitting.gauss_newton import score_of
from onlinebayes.identification.fitting.projection import per_noise
from onlinebayes.identification.judging.evaluator import AT_FLOOR, FIRST_STEPS, Evaluation, Evaluator, FitRequest
from onlinebayes.identification.judging.rule import LEAST_GAIN, equally_good, explains_half
from onlinebayes.identification.judging.scoring import Gain
from onlinebayes.identification.replaying.replay import replay_binned
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput, Stopped, side_by_side
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.identifiable import Identifiable

LEAST_FLOORS = 3.0
"""A base model that errs by fewer floors has no such fault."""

LEAST_PREDICTED_GAIN = 0.05
"""Nats that a fault's replay has to gain. Smoothed starts hide a part: columns a row apart promised 0.09."""

REFITS = 4
"""Faults that are fitted."""

FEW_RUNS = 4
"""Runs that show gross misfits; to put a table right costs as much as it has rows."""

POINTS = 6
"""Of the parameters' box, beside the fitted and the nominal values: what is wrong may have led the fit astray."""

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
    promising = _promising(evaluator, base, measurement, laws)
    tried = side_by_side([partial(judged, fault, evaluator, base, measurement) for fault in promising])
    return _best([one for one in tried if one is not None], evaluator, base, measurement)


def switched_off(evaluator: Evaluator, base: Evaluation, measurement: Measurement) -> CorrectedLog | None:
    """The actuators that were off for parts of runs, if that explains the misfit of the base model.

    It costs as much as a search: it is asked where no law leaves noise. Arguments as :func:`find_fault`.
    """
    if float(base.left_out[0].rms.max()) <= LEAST_FLOORS:
        return None
    evaluator.watch("checking whether an actuator was off")
    faults = [seen.settled for seen in _sightings(evaluator, base, measurement)]
    asked = [partial(judged, fault, evaluator, base, measurement) for fault in faults if fault is not None]
    tried = side_by_side(asked)
    most = max(filter(None, tried), key=lambda one: one.gains[0].gain, default=None)
    return None if most is None else _best([most], evaluator, base, measurement)


def _best(
    tried: Sequence[CorrectedLog], evaluator: Evaluator, base: Evaluation, measurement: Measurement
) -> CorrectedLog | None:
    """The simplest of those that explain most, with the others that do as well."""
    enough = [one for one in tried if _explains(one, base)]
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


def _explains(found: CorrectedLog, base: Evaluation) -> bool:
    return explains_half(base.left_out[0], found.evaluation.left_out[0])


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
        windows, stood = _in_both(_put_right(fault, given, evaluator.windows, measurement), evaluator.windows)
    except Stopped:
        raise
    except BadInput:
        return None
    if min(windows.observed.sum(), stood.observed.sum()) <= MOVING * evaluator.windows.observed.sum():
        return None  # of two faults that pass, each has more than half: they share a window
    anew = evaluator.of_table(given, windows)
    found = anew.evaluate(FitRequest(here.hypothesis, [here.values, {}], most=FIRST_STEPS))
    if found is not None and found.gains(here)[0].gain >= LEAST_GAIN:
        found = anew.anew(found)  # what gains nothing by then is no fault
    return None if found is None else CorrectedLog(fault, (), anew, found, found.gains(here))


def _in_both(windows: Windows, stood: Windows) -> tuple[Windows, Windows]:
    """The windows of two tables that lie where the other has one, too."""
    shared = set(windows.spans) & set(stood.spans)
    mine, theirs = (
        one.select(one.run.new_tensor([w for w, span in enumerate(one.spans) if span in shared]))
        for one in (windows, stood)
    )
    return mine, theirs


def _put_right(fault: Fault, given: Identifiable, windows: Windows, measurement: Measurement) -> Windows:
    """The same windows of the table put right, their starts too: for most faults it is not smoothed anew."""
    table, names = fault.correct(measurement), [signal.name for signal in measurement.signals]
    floor, memory = fault.noise(names, windows.noise), windows.history.shape[1] * windows.step
    if fault.smoothed_anew:
        return make_windows(given, table, windows.horizon, memory, floor)
    shown = [seen_by(joint, names).signal for joint in joint_names(given)]
    return make_windows(given, table, windows.horizon, memory, like=replace(fault.started(windows, shown), noise=floor))


def _promising(evaluator: Evaluator, base: Evaluation, measurement: Measurement, laws: bool) -> list[Fault]:
    """The faults whose replay gains most, in the order in which they are named."""
    thetas, few = _thetas(evaluator.given, base), _few(evaluator.windows)
    table = measurement.select(few.runs)
    stood = _replayed(AsItStands(), evaluator, thetas, few, table)
    faults = list(possible_faults(evaluator.given, measurement, late=not laws))
    replays = side_by_side([partial(_replayed, fault, evaluator, thetas, few, table) for fault in faults])
    promise = {
        fault: -math.inf if right is None or stood is None else right.gain(stood)
        for fault, right in zip(faults, replays, strict=True)
    }
    best = sorted(promise.values(), reverse=True)[:REFITS]
    return [fault for fault, gain in promise.items() if gain >= max(LEAST_PREDICTED_GAIN, best[-1])][:REFITS]


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


def _thetas(simulator: Simulator, base: Evaluation) -> Float[Tensor, "M P"]:
    """The fitted theta, the nominal one, and points of the box."""
    space, fitted = simulator.parameters, base.fitted.theta
    nominal = space.clamp(simulator.nominal.to(fitted))
    if not len(space):
        return nominal[None]
    draws = torch.quasirandom.SobolEngine(len(space), scramble=True, seed=0).draw(POINTS).to(fitted)
    return torch.cat([fitted[None], nominal[None], space.from_unit(draws)])


@dataclass(frozen=True, eq=False)
class _Replays:
    """Residuals of the signals of some windows by several thetas, in units of noise; those that did not diverge."""

    windows: Windows
    residuals: tuple[Float[Tensor, "W n S"], ...]

    def gain(self, other: _Replays) -> float:
        """By how much the best score is better than that of the other, over the windows that both have."""
        mine, theirs = _in_both(self.windows, other.windows)
        return other.over(theirs) - self.over(mine) if mine.count else -math.inf

    def over(self, some: Windows) -> float:
        """The best score over some of the windows."""
        place = {span: w for w, span in enumerate(self.windows.spans)}
        rows = [place[span] for span in some.spans]
        return min((score_of(some, one[rows]) for one in self.residuals), default=math.inf)


def _replayed(
    fault: Fault, evaluator: Evaluator, thetas: Float[Tensor, "M P"], few: Windows, measurement: Measurement
) -> _Replays | None:
    """The replays from the smoothed starts with the fault put right; None where there are none."""
    try:
        given = fault.model(evaluator.given)
        simulator = evaluator.discretisation.derivatives.of(given)
        windows, _ = _in_both(_put_right(fault, given, few, measurement), few)
    except Stopped:
        raise
    except BadInput:
        return None
    if not windows.count:
        return None
    starts = windows.start.expand(len(thetas), *windows.start.shape)
    shown, valid = replay_binned(simulator, windows, thetas, starts)
    measured, scale = windows.bin(windows.value), per_noise(windows)
    left = [(measured - one) * scale for one, good in zip(shown, valid, strict=True) if bool(good.all())]
    return _Replays(windows, tuple(left)) if left else None


def _few(windows: Windows) -> Windows:
    """Enough of the windows to tell gross misfits apart, of a few runs."""
    some = windows.of_runs([windows.runs[r] for r in _spread(windows.run.unique(), FEW_RUNS).tolist()])
    return some.select(_spread(torch.arange(some.count, device=some.run.device), 2 * REFITS))


def _spread(of: Int[Tensor, " N"], most: int) -> Int[Tensor, " M"]:
    """At most so many of some numbers, evenly spread."""
    return of[torch.linspace(0, len(of) - 1, min(len(of), most), device=of.device).round().long()]
