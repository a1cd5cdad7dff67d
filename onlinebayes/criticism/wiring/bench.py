"""What wiring faults are tried on: the base model on the coarsest rung, and the table with a fault put right."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.wiring.faults import AsItStands, Fault
from onlinebayes.criticism.wiring.hypotheses import hypotheses
from onlinebayes.identification.data.grid import row_step
from onlinebayes.identification.data.motion import seen_by
from onlinebayes.identification.data.noise import measured_floors
from onlinebayes.identification.data.windows import Windows, joint_names, make_windows
from onlinebayes.identification.fitting.fit import fit
from onlinebayes.identification.fitting.numerics import Grounds
from onlinebayes.identification.fitting.projection import signal_rms
from onlinebayes.identification.replaying.ladder import Rung, ladder
from onlinebayes.identification.replaying.replay import replay
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput
from onlinebayes.simulators.identifiable import Identifiable

DRAWS = 32  # of one parameter; of P parameters a P-th of them
FEWEST_DRAWS = 4
MOST_WINDOWS = 8  # that screening looks at
SCREENED_PARTS = (1.0, 0.5, 0.25)
MOVING = 0.5  # of what is scored in the table as it stands: a mended one in which less moves is a stilled one


@dataclass(frozen=True)
class Bench:
    """What hypotheses are tried on: the base model on the coarsest rung, and the table as it stands.

    Args:
        simulator: the base model at its own step.
        measurement: the fit runs.
        horizon: H [s].
        base: the base model fitted to the table as it stands.
        rung: a finer rung to try them on instead.
    """

    simulator: Identifiable
    measurement: Measurement
    horizon: float
    base: Grounds
    rung: Rung | None = None

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Every hypothesis but those about single runs."""
        return hypotheses(self.simulator, self.measurement)

    def windows(self, fault: Fault, noise: Float[Tensor, " S"]) -> Windows:
        """All windows with a fault put right, smoothed anew."""
        return make_windows(self.coarse, fault.mended(self.measurement), self.horizon, 0.0, noise)

    def replayed(self, fault: Fault, thetas: Float[Tensor, "M P"]) -> Float[Tensor, "M W"]:
        """RMS of every window's replay from its smoothed start [floors]; infinite where it diverged.

        Args:
            fault: what is put right.
            thetas: M parameter vectors [SI].
        """
        windows = self._mended(fault, self.whole, self.measurement)
        return replay_rms(self._first_order(fault), windows, thetas, windows.noise)

    def screened(self, fault: Fault, thetas: Float[Tensor, "M P"]) -> Float[Tensor, "C M"]:
        """The same over the first rows of a window, as :data:`SCREENED_PARTS` says, mean over the excerpt."""
        windows = self._mended(fault, self._part, self.excerpt)
        return replay_rms_of_parts(self._first_order(fault), windows, thetas, windows.noise).mean(-1)

    def refitted(self, fault: Fault, theta: Float[Tensor, " P"]) -> tuple[float, Float[Tensor, " P"]] | None:
        """Start-projected RMS [floors] once the parameters are fitted anew to the table put right, and their values.

        None where the fault stills what moves, or the table put right in a wrong way diverges.

        Args:
            fault: what is put right.
            theta: where the fit begins [SI].
        """
        try:
            floor = self.floor(fault)
            windows = self.windows(fault, floor)
            if windows.observed.sum() < MOVING * self.whole.observed.sum():
                return None
            fitted = fit(self.model(fault), windows, theta)
        except BadInput:
            return None
        return total(signal_rms(fitted.projected), floor / self.carried(fault)), fitted.theta

    def _mended(self, fault: Fault, own: Windows, table: Measurement) -> Windows:
        """A table's windows with the fault put right, in the starts too: for most it is not smoothed anew."""
        floor = self.carried(fault)
        if fault.smoothed_anew:
            return make_windows(self.coarse, fault.mended(table), self.horizon, 0.0, floor)
        names = [signal.name for signal in table.signals]
        shown = [seen_by(joint, names).signal for joint in joint_names(self.simulator)]
        like = replace(fault.started(own, shown), noise=floor)
        return make_windows(self.coarse, fault.mended(table), self.horizon, like=like)

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

    def model(self, fault: Fault) -> Identifiable:
        """The coarse model with a fault put right."""
        return fault.model(self.coarse)

    def _first_order(self, fault: Fault) -> Identifiable:
        """The same by a method of first order: hundreds of replays tell gross misfits apart, and a few are fitted."""
        return self.model(fault).with_first_order()

    def floor(self, fault: Fault) -> Float[Tensor, " S"]:
        """The floor that the table has once the fault is put right [SI]."""
        return measured_floors(fault.mended(self.measurement)).to(self.base.windows.noise)

    def carried(self, fault: Fault) -> Float[Tensor, " S"]:
        """The table's floor as it stands, put right like the table [SI]: what errors are counted in."""
        return fault.noise([signal.name for signal in self.measurement.signals], self.base.windows.noise)

    def thetas(self) -> Float[Tensor, "M P"]:
        """The fitted theta, the nominal one, and points of the box."""
        space, fitted = self.simulator.parameters, self.base.fitted.theta
        nominal = space.clamp(self.simulator.nominal.to(fitted))
        if not len(space):
            return nominal[None]
        count = max(FEWEST_DRAWS, DRAWS // len(space))
        draws = torch.quasirandom.SobolEngine(len(space), scramble=True, seed=0).draw(count).to(fitted)
        return torch.cat([fitted[None], nominal[None], space.from_unit(draws)])

    @cached_property
    def coarse(self) -> Identifiable:
        """The base model on the rung."""
        return self._rung.of(self.simulator)

    @property
    def _rung(self) -> Rung:
        if self.rung is not None:
            return self.rung
        # By its own method: where nothing is wrong, an error of first order would pass for a fault.
        rungs = ladder(self.simulator, self.horizon, row_step(self.measurement))
        return next(rung for rung in rungs if rung.method == "own")


def total(by_signal: Float[Tensor, " S"], unit: Float[Tensor, " S"] | float = 1.0) -> float:
    """RMS over all signals [floors], each in units of its own."""
    return float((by_signal * unit).square().mean().sqrt())


def replay_rms(
    simulator: Identifiable, windows: Windows, thetas: Float[Tensor, "M P"], floor: Float[Tensor, " S"]
) -> Float[Tensor, "M W"]:
    """RMS of every window's replay from its smoothed start [floors]; infinite where it diverged."""
    return replay_rms_of_parts(simulator, windows, thetas, floor)[0]


def replay_rms_of_parts(
    simulator: Identifiable, windows: Windows, thetas: Float[Tensor, "M P"], floor: Float[Tensor, " S"]
) -> Float[Tensor, "C M W"]:
    """The same over the first rows of each window, as many as each of :data:`SCREENED_PARTS` says.

    What diverges later holds its last finite values, and counts with them in the parts before.
    """
    starts = windows.start.expand(len(thetas), *windows.start.shape)
    signals, valid = replay(simulator, windows, thetas, starts)
    wrong = torch.where(windows.observed, (windows.value - signals) / floor, torch.zeros_like(signals)).square()
    found = []
    for part in SCREENED_PARTS:
        rows = max(1, round(part * windows.rows))
        seen = windows.observed[:, :rows].sum((1, 2)).clamp_min(1)
        rms = (wrong[:, :, :rows].sum((2, 3)) / seen).sqrt()
        found.append(torch.where(valid if part == 1.0 else rms.isfinite(), rms, torch.full_like(rms, math.inf)))
    return torch.stack(found)
