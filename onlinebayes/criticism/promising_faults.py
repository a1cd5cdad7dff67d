"""Which faults of the log are worth a fit: one replay each with the fault put right, starts and theta moved.

    promise(fault) = score of the table as it stands - score of it put right,      each by the best of some thetas

Starts and theta move to first order, as in the fit of the base model: from smoothed starts a column that is a
row late would look no better put right, for the starts are late themselves. A few windows of a few runs show gross
misfits; to put a table right costs as much as it has rows.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.criticism.wiring.faults import AsItStands, Fault
from onlinebayes.criticism.wiring.possible import possible_faults
from onlinebayes.identification.data.motion import seen_by
from onlinebayes.identification.data.windows import Windows, joint_names, make_windows
from onlinebayes.identification.fitting.discretisation import cost_of
from onlinebayes.identification.fitting.gauss_newton import score_of
from onlinebayes.identification.fitting.projection import per_noise
from onlinebayes.identification.fitting.rows import Rows, starts_part
from onlinebayes.identification.fitting.theta import room
from onlinebayes.identification.judging.evaluator import Evaluation, Evaluator
from onlinebayes.identification.replaying.bounded import bounded_least_squares
from onlinebayes.identification.replaying.integration import Integration
from onlinebayes.identification.replaying.replay import replay_binned
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput, Stopped, side_by_side
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.identifiable import Identifiable

LEAST_PREDICTED_GAIN = -0.1
"""Nats that a fault has to promise: theta moves to first order only; signals a row ahead promised -0.08, gained 1.4."""

REFITS = 4
"""Faults that are fitted."""

FEW_RUNS = 4
"""Runs from which windows are taken."""

POINTS = 6
"""Of the parameters' box, beside the fitted and the nominal values: what is wrong may have led the fit astray."""


def promising_faults(evaluator: Evaluator, base: Evaluation, measurement: Measurement, laws: bool) -> list[Fault]:
    """The faults whose replay gains most, in the order in which they are named.

    Args:
        evaluator, base: the base model fitted to the table as it stands.
        measurement: the fit runs.
        laws: whether laws are tried, too; where none is, columns that are late are looked for.
    """
    thetas, few = _thetas(evaluator.given, base), _few(evaluator.windows)
    table = measurement.select(few.runs)
    way = _roughest(evaluator, few)
    stood = _replayed(AsItStands(), evaluator, way, base, thetas, few, table)
    faults = list(possible_faults(evaluator.given, measurement, late=not laws))
    replays = side_by_side([partial(_replayed, fault, evaluator, way, base, thetas, few, table) for fault in faults])
    promise = {
        fault: -math.inf if right is None or stood is None else right.gain(stood)
        for fault, right in zip(faults, replays, strict=True)
    }
    best = sorted(promise.values(), reverse=True)[:REFITS]
    return [fault for fault, gain in promise.items() if gain >= max(LEAST_PREDICTED_GAIN, best[-1])][:REFITS]


def in_both(windows: Windows, stood: Windows) -> tuple[Windows, Windows]:
    """The windows of two tables that lie where the other has one, too."""
    shared = set(windows.spans) & set(stood.spans)
    mine, theirs = (
        one.select(one.run.new_tensor([w for w, span in enumerate(one.spans) if span in shared]))
        for one in (windows, stood)
    )
    return mine, theirs


def rows_over(some: Windows, base: Evaluation, fitted: Windows) -> Rows:
    """The rows of a fitted model in some of its windows."""
    place = {span: w for w, span in enumerate(fitted.spans)}
    return base.fitted.of(some.run.new_tensor([place[span] for span in some.spans])).rows


def put_right(fault: Fault, given: Identifiable, windows: Windows, measurement: Measurement) -> Windows:
    """The same windows of the table put right, their starts too: for most faults it is not smoothed anew."""
    table, names = fault.correct(measurement), [signal.name for signal in measurement.signals]
    floor, memory = fault.noise(names, windows.noise), windows.history.shape[1] * windows.step
    if fault.smoothed_anew:
        return make_windows(given, table, windows.horizon, memory, floor)
    shown = [seen_by(joint, names).signal for joint in joint_names(given)]
    return make_windows(given, table, windows.horizon, memory, like=replace(fault.started(windows, shown), noise=floor))


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
        mine, theirs = in_both(self.windows, other.windows)
        return other.over(theirs) - self.over(mine) if mine.count else -math.inf

    def over(self, some: Windows) -> float:
        """The best score over some of the windows."""
        place = {span: w for w, span in enumerate(self.windows.spans)}
        rows = [place[span] for span in some.spans]
        return min((score_of(some, one[rows]) for one in self.residuals), default=math.inf)


def _replayed(
    fault: Fault,
    evaluator: Evaluator,
    way: Integration,
    base: Evaluation,
    thetas: Float[Tensor, "M P"],
    few: Windows,
    measurement: Measurement,
) -> _Replays | None:
    """The replays with the fault put right, each window from its best start to first order; None where there are none.

    From smoothed starts a column that is a row late would look no better put right: the starts are late themselves.
    """
    try:
        given = fault.model(evaluator.given)
        simulator = way.of(given)
        windows, _ = in_both(put_right(fault, given, few, measurement), few)
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
    left = [
        best
        for k, one in enumerate(left)
        for best in _at_best(one, base, evaluator.windows, windows, moving=k == 0 and bool(valid[0].all()))
    ]
    # The runs stay behind: each fault has a whole table of its own.
    return _Replays(replace(windows, run_histories=()), tuple(left)) if left else None


def _roughest(evaluator: Evaluator, windows: Windows) -> Integration:
    """The cheapest way that is known to run: gross misfits show by any, and a stiff machine's fits take many steps."""
    ways = (evaluator.discretisation.derivatives, Integration(evaluator.given.timestep))
    return min(ways, key=cost_of(evaluator.given, windows.step))


def _at_best(
    residual: Float[Tensor, "V n S"], base: Evaluation, fitted: Windows, some: Windows, *, moving: bool
) -> Iterator[Float[Tensor, "V n S"]]:
    """What is left in some of the fitted windows when starts have moved as the base model asks, then theta [floors].

    Args:
        residual: of the replay [floors].
        base: the base model fitted to the table as it stands.
        fitted, some: its windows, and those that were replayed.
        moving: whether the replay is that of its theta, which may move then.
    """
    rows = rows_over(some, base, fitted)
    scaled = (residual * rows.weight).flatten(1)
    full = torch.cat([scaled, scaled.new_zeros(len(scaled), rows.basis.shape[1] - scaled.shape[1])], dim=1)
    left = full - starts_part(rows, full)
    yield rows.in_noise(left)
    if moving and rows.columns.shape[-1]:
        C, r = rows.columns.flatten(0, 1), left.flatten()
        step = bounded_least_squares(C.T @ C, C.T @ r, *room(base.fitted.simulator, base.fitted.theta))
        yield rows.in_noise(left - rows.columns @ step)


def _few(windows: Windows) -> Windows:
    """Enough of the windows to tell gross misfits apart, of a few runs."""
    some = windows.of_runs([windows.runs[r] for r in _spread(windows.run.unique(), FEW_RUNS).tolist()])
    return some.select(_spread(torch.arange(some.count, device=some.run.device), 2 * REFITS))


def _spread(of: Int[Tensor, " N"], most: int) -> Int[Tensor, " M"]:
    """At most so many of some numbers, evenly spread."""
    return of[torch.linspace(0, len(of) - 1, min(len(of), most), device=of.device).round().long()]
