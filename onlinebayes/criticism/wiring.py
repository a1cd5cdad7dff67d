"""The wiring check, before effects are blamed: does a reversed sign, a wrong unit, a swapped column explain the misfit?

    s(fault) = mean over windows of the RMS of the replay from the smoothed starts, best of some thetas   screened
    r(fault) = start-projected RMS after a fit on the coarsest rung                                       fitted
    e(fault) = cross-validated RMS at H after the same road as the base model's                           judged

A fault is screened in when s falls below 0.8 of the table's own as it stands, and judged when r falls to half of the
base model's. The best one explains the misfit when e is at most half of the base model's. It is ``certain`` when its
RMS at the rows reaches the floor too: it needs no parameter, so that no effect can explain as much with less. Otherwise
it must do at least as well as the model with every accepted effect. Errors are counted in units of a floor that carries
the fault's factor along: dividing a column by 57 makes no error smaller.

A base model within three floors is not looked at: no fault of this kind is that small.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.faults import AsItStands, Fault, SwitchedOff
from onlinebayes.criticism.fit import fit
from onlinebayes.criticism.grid import row_step, run_grids
from onlinebayes.criticism.hypotheses import hypotheses
from onlinebayes.criticism.ladder import Rung, ladder
from onlinebayes.criticism.motion import seen_by
from onlinebayes.criticism.noise import floors
from onlinebayes.criticism.numerics import Grounds, settle
from onlinebayes.criticism.projection import signal_rms
from onlinebayes.criticism.replay import replay
from onlinebayes.criticism.results import Selection
from onlinebayes.criticism.score import cross_validate
from onlinebayes.criticism.stage import blocks_for
from onlinebayes.criticism.verdict import rms_over_floor
from onlinebayes.criticism.windows import Windows, joint_names, make_windows
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator

GROSS = 3.0  # floors
PROMISING = 0.8
HALF = 0.5
EQUAL = 1.05
OFF = 0.5  # of a run's error: what an actuator that was off there must leave at most
OVERWHELMING = 0.3
DRAWS = 4
MOST_WINDOWS = 8  # that screening looks at
MOST_FITS = 4
NEAR = 3.0  # of the best screened fault's error: what another may have to be fitted


@dataclass(frozen=True)
class Suspicion:
    """The fault that explains the misfit best.

    Args:
        fault: what it is.
        equals: faults that explain as much.
        before, after: cross-validated RMS of the base model and of the same model with the fault put right [floors].
        certain: whether nothing but noise is left then.
    """

    fault: Fault
    equals: tuple[Fault, ...]
    before: float
    after: float
    certain: bool

    def beats(self, final: Grounds, selection: Selection) -> bool:
        """Whether it does at least as well as the model with every accepted effect."""
        return self.certain or self.after <= _total(cross_validated(final, selection))


@dataclass(frozen=True)
class Leads:
    """The faults that the replay from the smoothed starts speaks for, none of them fitted yet.

    Args:
        bench: what they are tried on.
        faults: in the order of the hypotheses, each with the theta that suits it best.
        share: the best one's error over that of the table as it stands; infinite without any.
    """

    bench: Bench
    faults: tuple[tuple[Fault, Float[Tensor, " P"]], ...]
    share: float

    @property
    def overwhelming(self) -> bool:
        """Whether one replays so much better that it is worth a fit before any effect is."""
        return self.share < OVERWHELMING

    def explain(self, selection: Selection) -> Suspicion | None:
        """The fault that explains the base model's misfit once the parameters are fitted anew, if one does."""
        limit = HALF * _total(signal_rms(self.bench.base.fitted.projected))
        found = [(error, fault) for error, fault in _fitted(self.bench, self.faults) if error <= limit]
        if not found:
            return None
        best = min(error for error, _ in found)
        return _judged([fault for error, fault in found if error <= EQUAL * best], self.bench, selection)


def look(
    base: Grounds, simulator: Simulator, measurement: Measurement, selection: Selection, say: Callable[[str], None]
) -> Leads | None:
    """Screen every hypothesis by replay alone; None where the base model errs by too little for such a fault.

    Args:
        base: the base model fitted to the measurement as it stands.
        simulator: the base model at its own step.
        measurement: the fit runs.
        selection: how effects are judged.
        say: takes one line of progress.
    """
    rms = float(signal_rms(base.fitted.projected).max())
    if rms <= max(GROSS, selection.tolerance):
        return None
    say("checking signs, units and columns")
    return _promising(Bench(simulator, measurement, selection.horizon_s, base))


@dataclass(frozen=True)
class Bench:
    """What hypotheses are tried on: the base model on the coarsest rung, and the table as it stands."""

    simulator: Simulator
    measurement: Measurement
    horizon: float
    base: Grounds

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Every hypothesis but those about single runs."""
        return hypotheses(self.simulator, self.measurement)

    def windows(self, fault: Fault, noise: Float[Tensor, " S"]) -> Windows:
        """All windows with a fault put right, smoothed anew."""
        return make_windows(self.coarse, fault.mended(self.measurement), self.horizon, 0.0, noise)

    def replayed(self, fault: Fault, thetas: Float[Tensor, "M P"], excerpt: bool = False) -> Float[Tensor, "M W"]:
        """RMS of every window's replay from its smoothed start [floors]; infinite where it diverged.

        Args:
            fault: what is put right, in the starts too: the table is smoothed once, as it stands, for most faults.
            thetas: M parameter vectors [SI].
            excerpt: replay only the windows that are enough to screen by.
        """
        floor = self.carried(fault)
        own, table = (self._part, self.excerpt) if excerpt else (self.whole, self.measurement)
        if fault.smoothed_anew:
            windows = make_windows(self.coarse, fault.mended(table), self.horizon, 0.0, floor)
        else:
            names = [signal.name for signal in table.signals]
            shown = [seen_by(joint, names).signal for joint in joint_names(self.simulator)]
            like = replace(fault.started(own, shown), noise=floor)
            windows = make_windows(self.coarse, fault.mended(table), self.horizon, like=like)
        starts = windows.start.expand(len(thetas), *windows.start.shape)
        signals, valid = replay(self.model(fault), windows, thetas, starts)
        wrong = torch.where(windows.observed, (windows.value - signals) / floor, torch.zeros_like(signals))
        rms = (wrong.square().sum((2, 3)) / windows.observed.sum((1, 2)).clamp_min(1)).sqrt()
        return torch.where(valid, rms, torch.full_like(rms, float("inf")))

    @cached_property
    def whole(self) -> Windows:
        """All windows of the table as it stands."""
        same = self.base.rung == self._rung
        return self.base.windows if same else self.windows(AsItStands(), self.base.windows.noise)

    @cached_property
    def _part(self) -> Windows:
        return make_windows(self.coarse, self.excerpt, self.horizon, 0.0, self.base.windows.noise)

    @cached_property
    def excerpt(self) -> Measurement:
        """Runs, evenly chosen, that hold enough windows; the beginning of a run that is long enough alone."""
        data, enough = self.measurement, MOST_WINDOWS * self.horizon
        mean = sum(data.durations) / len(data.runs)
        if mean >= 2 * enough:
            rows = int(data.lengths[0] * enough / mean)
            return data.rows(data.runs[0], 0, rows)
        return data.select(data.runs[:: max(1, int(len(data.runs) * mean / enough))])

    def model(self, fault: Fault) -> Simulator:
        """The coarse model with a fault put right."""
        return fault.model(self.coarse)

    def floor(self, fault: Fault) -> Float[Tensor, " S"]:
        """The floor that the table has once the fault is put right [SI]."""
        mended = fault.mended(self.measurement)
        return floors(mended.signals, run_grids(mended, row_step(mended))).to(self.base.windows.noise)

    def carried(self, fault: Fault) -> Float[Tensor, " S"]:
        """The table's floor as it stands, put right like the table [SI]: what errors are counted in."""
        return fault.noise([signal.name for signal in self.measurement.signals], self.base.windows.noise)

    def thetas(self) -> Float[Tensor, "M P"]:
        """The fitted theta, the nominal one, and points of the box."""
        space, fitted = self.simulator.parameters, self.base.fitted.theta
        nominal = space.clamp(self.simulator.nominal.to(fitted))
        if not len(space):
            return nominal[None]
        draws = torch.quasirandom.SobolEngine(len(space), scramble=True, seed=0).draw(DRAWS).to(fitted)
        return torch.cat([fitted[None], nominal[None], space.from_unit(draws)])

    @cached_property
    def coarse(self) -> Simulator:
        """The base model on the coarsest rung."""
        return self._rung.of(self.simulator)

    @property
    def _rung(self) -> Rung:
        return ladder(self.simulator, self.horizon)[0]


def _promising(bench: Bench) -> Leads:
    """The hypotheses replayed from the smoothed starts."""
    thetas = bench.thetas()
    found: list[tuple[float, Fault, Float[Tensor, " P"]]] = []
    own = bench.replayed(AsItStands(), thetas, True).mean(1).min()
    for fault in bench.faults:
        error = bench.replayed(fault, thetas, True).mean(1)
        found.append((float(error.min() / own), fault, thetas[int(error.argmin())]))
    everywhere = bench.replayed(AsItStands(), thetas)
    for fault in _switched_off(bench, thetas, everywhere):  # single runs that differ: all must be seen
        error = bench.replayed(fault, thetas).mean(1)
        found.append((float(error.min() / everywhere.mean(1).min()), fault, thetas[int(error.argmin())]))
    best = sorted(share for share, _, _ in found if share < PROMISING)[:MOST_FITS]
    kept = tuple((fault, theta) for share, fault, theta in found if share in best and share <= NEAR * best[0])
    return Leads(bench, kept, best[0] if best else float("inf"))


def _switched_off(bench: Bench, thetas: Float[Tensor, "M P"], own: Float[Tensor, "M W"]) -> list[SwitchedOff]:
    """For each actuator, the runs that go better without it, at the theta at which that explains most."""
    found, runs = [], bench.measurement.runs
    for actuator in bench.simulator.commands:
        off = bench.replayed(SwitchedOff(actuator, runs), thetas)
        with_it, without = (e.new_zeros(len(e), len(runs)).index_add(1, bench.whole.run, e) for e in (own, off))
        best = int(torch.minimum(with_it, without).sum(1).argmin())
        idle = [
            run for run, a, b in zip(runs, with_it[best].tolist(), without[best].tolist(), strict=True) if b < OFF * a
        ]
        if idle:
            found.append(SwitchedOff(actuator, tuple(idle)))
    return found


def _fitted(bench: Bench, promising: Sequence[tuple[Fault, Float[Tensor, " P"]]]) -> list[tuple[float, Fault]]:
    """Start-projected RMS with each fault put right and the parameters fitted anew [floors]."""
    found = []
    for fault, theta in promising:
        try:
            floor = bench.floor(fault)
            fitted = fit(bench.model(fault), bench.windows(fault, floor), theta)
        except BadInput:  # a table put right in a wrong way may diverge
            continue
        found.append((_total(signal_rms(fitted.projected), floor / bench.carried(fault)), fault))
    return found


def _total(by_signal: Float[Tensor, " S"], unit: Float[Tensor, " S"] | float = 1.0) -> float:
    """RMS over all signals [floors], each in units of its own."""
    return float((by_signal * unit).square().mean().sqrt())


def _judged(alike: Sequence[Fault], bench: Bench, selection: Selection) -> Suspicion | None:
    """The first of the faults that explain most, along the base model's road."""
    fault = alike[0]
    floor, carried = bench.floor(fault), bench.carried(fault)
    try:
        grounds = settle(fault.model(bench.simulator), fault.mended(bench.measurement), bench.horizon, floor)
    except BadInput:
        return None
    before = _total(cross_validated(bench.base, selection))
    after = _total(cross_validated(grounds, selection), floor / carried)
    if after > HALF * before:
        return None
    left = rms_over_floor(grounds.fitted, grounds.windows, grounds.numerics, False)
    certain = grounds.numerics.sufficient and max(left.values()) <= selection.tolerance
    return Suspicion(fault, tuple(alike[1:]), before, after, certain)


def cross_validated(grounds: Grounds, selection: Selection) -> Float[Tensor, " S"]:
    """Cross-validated RMS of each signal at H [floors]; the fit's own where the data make a single block."""
    blocks = blocks_for(grounds.fitted, grounds.windows, selection.folds)
    if blocks.count < 2:
        return signal_rms(grounds.fitted.projected)
    return cross_validate(grounds.fitted, grounds.windows, blocks).signal_rms
