"""The wiring check, before effects are blamed: does a reversed sign, a wrong unit, a swapped column explain the misfit?

    s(fault) = mean over windows of the RMS of the replay from the smoothed starts, best of some thetas   screened
    r(fault) = start-projected RMS after a fit on the coarsest rung                                       fitted
    e(fault) = cross-validated RMS at H after the same fit as the base model's                            judged

A fault is screened in when s falls below 0.8 of the table's own as it stands, over whole windows or over their first
half or quarter alone: over a second, an arm that falls is as wrong with any theta but the true one as with a wrong
unit. It is judged when r falls to half of the base model's. The best one explains the misfit when e is at most half of
the base model's. It is ``certain`` when its RMS at the rows reaches the floor too: it needs no parameter, so that no
effect can explain as much with less. Otherwise it must do at least as well as the model with every accepted effect.
Errors are counted in units of a floor that carries the fault's factor along, and in those of the mended table: dividing
a column by 57 makes no error smaller, multiplying it no floor larger. Nor does a fault explain what it stills: a column
in thousandths moves by less than its sensor's noise, and would not be scored.

A base model within three floors is not looked at: no fault of this kind is that small.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.judging.score import cross_validate
from onlinebayes.criticism.judging.verdict import left_over
from onlinebayes.criticism.searching.stage import blocks_for
from onlinebayes.criticism.wiring.bench import Bench, total
from onlinebayes.criticism.wiring.faults import AsItStands, Fault, SwitchedOff
from onlinebayes.criticism.wiring.outages import outage, sudden
from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.fitting.horizon import steady
from onlinebayes.identification.fitting.numerics import Grounds, settle
from onlinebayes.identification.fitting.projection import misfit, signal_rms
from onlinebayes.identification.results import Selection
from onlinebayes.measurements import Measurement
from onlinebayes.runs import UNWATCHED, BadInput, Watch
from onlinebayes.simulators.identifiable import Identifiable

LEAST_FLOORS = 3.0
"""A base model that errs by fewer floors has no such fault."""

SCREENED_SHARE = 0.8
"""A fault whose replay leaves less than this share of the error of the table as it stands is screened in."""

EXPLAINED_SHARE = 0.5
"""A fault that explains the misfit leaves this share of the base model's error at most."""

EQUAL_ERROR_RATIO = 1.05
"""Faults that leave up to so many times the error of the best one explain as much."""

IDLE_SHARE = 0.5
"""An actuator was off in a run whose error falls below this share without it."""

OUTAGE_WINDOW_PARTS = (1.0, 0.25)
"""Outages are looked for in windows of these parts of H: in short runs one in each may strike every whole window."""

OVERWHELMING = 0.5
"""A fault whose replay leaves less than this share of the error is fitted before any effect is."""

DECISIVE = 0.1
"""An outage that leaves this share of the error at most needs no effect to be tried."""

MOST_FITS = 4
"""So many screened faults are fitted at most."""

NEAR_BEST_RATIO = 3.0
"""A fault is fitted only where its share of the error is at most so many times that of the best one."""


@dataclass(frozen=True)
class Suspicion:
    """The fault that explains the misfit best.

    Args:
        fault: what it is.
        equals: faults that explain as much.
        before, after: cross-validated RMS of the base model and of the same model with the fault put right [floors of
            the table as it stands, which carry the fault's factor along].
        left: the latter in floors of the table put right: where the sensor's sd was given in SI, that is what it means.
        certain: whether nothing but noise is left then.
        grounds: the model fitted to the table put right.
    """

    fault: Fault
    equals: tuple[Fault, ...]
    before: float
    after: float
    left: float
    certain: bool
    grounds: Grounds

    @property
    def decisive(self) -> bool:
        """Whether it leaves so little that no effect needs to be tried."""
        return self.certain or self.after <= DECISIVE * self.before

    def beats(self, final: Grounds, selection: Selection, share: float = 1.0) -> bool:
        """Whether it leaves no more than that share of what the model with every accepted effect leaves."""
        return self.certain or self.after <= share * total(cross_validated(final, selection))


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

    @property
    def sudden(self) -> bool:
        """Whether an actuator that was off for a while is worth looking for before any effect is."""
        return bool(self.bench.simulator.commands) and sudden(self.bench.base, self.bench.coarse, self.bench.whole)

    def explain(self, selection: Selection) -> Suspicion | None:
        """The fault that explains the base model's misfit once the parameters are fitted anew, if one does."""
        limit = EXPLAINED_SHARE * total(signal_rms(self.bench.base.fitted.projected))
        fits = [(self.bench.refitted(fault, theta), fault) for fault, theta in self.faults]
        found = [(fitted[0], fault) for fitted, fault in fits if fitted is not None and fitted[0] <= limit]
        if not found:
            return None
        best = min(error for error, _ in found)
        return _judged([fault for error, fault in found if error <= EQUAL_ERROR_RATIO * best], self.bench, selection)


def screen_faults(
    base: Grounds,
    simulator: Identifiable,
    measurement: Measurement,
    selection: Selection,
    watch: Watch = UNWATCHED,
) -> Leads | None:
    """Screen every hypothesis by replay alone; None where the base model errs by too little for such a fault.

    Args:
        base: the base model fitted to the measurement as it stands.
        simulator: the base model at its own step.
        measurement: the fit runs.
        selection: how effects are judged.
        watch: takes one line of progress.
    """
    rms = misfit(base.fitted.projected)
    if rms <= max(LEAST_FLOORS, selection.tolerance):
        return None
    watch.say("checking signs, units and columns")
    return _promising(Bench(simulator, measurement, selection.horizon_s, base))


def fit_faults(
    faults: Sequence[tuple[Fault, Float[Tensor, " P"]]],
    base: Grounds,
    simulator: Identifiable,
    measurement: Measurement,
    selection: Selection,
) -> Suspicion | None:
    """What the best of these faults explains once fitted, something else than the screening having spoken for them.

    Args:
        faults: each with the theta at which its fit begins [SI].
        base, simulator, measurement, selection: as in :func:`screen_faults`.
    """
    bench = Bench(simulator, measurement, selection.horizon_s, base)
    return Leads(bench, tuple(faults), 1.0).explain(selection)


def outages(
    base: Grounds,
    simulator: Identifiable,
    measurement: Measurement,
    selection: Selection,
    watch: Watch = UNWATCHED,
) -> Suspicion | None:
    """Actuators that were off for parts of runs, if that explains the misfit; arguments as :func:`screen_faults`."""
    if not simulator.commands:
        return None
    watch.say("looking for actuators that were off for a while")
    bench = Bench(simulator, measurement, selection.horizon_s, base)
    seen: list[Suspicion] = []
    for part in OUTAGE_WINDOW_PARTS:
        try:
            short = make_windows(bench.coarse, measurement, part * selection.horizon_s, 0.0, base.windows.noise)
            found = outage(base, bench.coarse, short)
        except BadInput:  # on the coarsest rung the model diverges
            break
        suspicion = None if found is None else Leads(bench, (found,), 1.0).explain(selection)
        if suspicion is not None and suspicion.certain:
            return suspicion
        seen += [] if suspicion is None else [suspicion]
    return min(seen, key=lambda one: one.after, default=None)


@dataclass(frozen=True)
class _Screened:
    """A hypothesis replayed: its error over that of the table as it stands, the error [floors], and the theta."""

    share: float
    error: float
    fault: Fault
    theta: Float[Tensor, " P"]


def _promising(bench: Bench) -> Leads:
    """The hypotheses replayed from the smoothed starts, each at the theta and over the part that speak for it."""
    thetas = bench.thetas()
    own = bench.screened(AsItStands(), thetas).amin(1, keepdim=True)
    screened = []
    for fault in bench.faults:
        error = bench.screened(fault, thetas)
        part, best = divmod(int((error / own).nan_to_num(math.inf).argmin()), len(thetas))
        screened.append(_Screened(float(error[part, best] / own[part]), float(error[part, best]), fault, thetas[best]))
    everywhere = bench.replayed(AsItStands(), thetas)
    single = []
    for fault in _switched_off(bench, thetas, everywhere):  # single runs that differ: all must be seen
        error = bench.replayed(fault, thetas).mean(1)
        best = int(error.argmin())
        share = float(error[best] / everywhere.mean(1).min())
        single.append(_Screened(share, float(error[best]), fault, thetas[best]))
    kept = [*_best(screened), *_best(single)]
    return Leads(
        bench, tuple((one.fault, one.theta) for one in kept), min((one.share for one in kept), default=math.inf)
    )


def _best(screened: Sequence[_Screened]) -> list[_Screened]:
    """Those worth a fit, in the order of the hypotheses."""
    promising = [one for one in screened if one.share < SCREENED_SHARE]
    ranked = sorted(promising, key=lambda one: (one.share, one.error))[:MOST_FITS]
    return [
        one
        for one in promising
        if any(one is other for other in ranked) and one.share <= NEAR_BEST_RATIO * ranked[0].share
    ]


def _switched_off(bench: Bench, thetas: Float[Tensor, "M P"], own: Float[Tensor, "M W"]) -> list[SwitchedOff]:
    """For each actuator, the runs that go better without it, at the theta at which that explains most."""
    found, runs = [], bench.measurement.runs
    for actuator in bench.simulator.commands:
        off = bench.replayed(SwitchedOff(actuator, runs), thetas)
        with_it, without = (e.new_zeros(len(e), len(runs)).index_add(1, bench.whole.run, e) for e in (own, off))
        best = int(torch.minimum(with_it, without).sum(1).argmin())
        idle = [
            run
            for run, a, b in zip(runs, with_it[best].tolist(), without[best].tolist(), strict=True)
            if b < IDLE_SHARE * a
        ]
        if idle:
            found.append(SwitchedOff(actuator, tuple(idle)))
    return found


def _judged(alike: Sequence[Fault], bench: Bench, selection: Selection) -> Suspicion | None:
    """The first of the faults that explain most, along the base model's road."""
    fault = alike[0]
    floor, carried = bench.floor(fault), bench.carried(fault)
    try:
        grounds = settle(fault.model(bench.simulator), fault.mended(bench.measurement), bench.horizon, floor)
    except BadInput:
        return None
    before = total(cross_validated(bench.base, selection))
    after = total(cross_validated(grounds, selection), floor / carried)
    left = total(cross_validated(grounds, selection))
    if max(after, left) > EXPLAINED_SHARE * before:
        return None
    certain = _at_the_floor(grounds, selection) or _at_the_floor(_steadied(fault, floor, bench, selection), selection)
    return Suspicion(fault, tuple(alike[1:]), before, after, left, certain, grounds)


def _steadied(fault: Fault, floor: Float[Tensor, " S"], bench: Bench, selection: Selection) -> Grounds | None:
    """The model with the fault put right, over windows as short as that takes; None where they are long enough.

    The table as it stands may hide that the machine falls: nothing tells which way an arm leans whose angles are wrong.
    """
    model, mended = fault.model(bench.simulator), fault.mended(bench.measurement)
    shorter = steady(model, mended, selection).horizon_s
    return settle(model, mended, shorter, floor) if shorter < bench.horizon else None


def _at_the_floor(grounds: Grounds | None, selection: Selection) -> bool:
    """Whether nothing but noise is left."""
    if grounds is None or not grounds.numerics.sufficient:
        return False
    return max(left_over(grounds).values()) <= selection.tolerance


def cross_validated(grounds: Grounds, selection: Selection) -> Float[Tensor, " S"]:
    """Cross-validated RMS of each signal at H [floors]; the fit's own where the data make a single block."""
    blocks = blocks_for(grounds.fitted, grounds.windows, selection.folds)
    if blocks.count < 2:
        return signal_rms(grounds.fitted.projected)
    return cross_validate(grounds.fitted, grounds.windows, blocks).signal_rms
