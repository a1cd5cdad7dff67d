"""Wiring faults: what can be wrong between the sensors' wires and the table, and the line that puts it right.

| fault                   | what the table holds                                  | mended                         |
|-------------------------|-------------------------------------------------------|--------------------------------|
| :class:`Rescaled`       | -y, degrees for radians, mm for m; -u, mV for V       | factor times column            |
| :class:`WholeLog`       | all positions of hinges and all commands in degrees   | factor times the columns       |
| :class:`Offset`         | y - c, a zero that was set elsewhere                  | y + c                          |
| :class:`Swapped`        | another joint's or actuator's column                  | the two exchanged              |
| :class:`Compensated`    | commands on top of a controller that holds the weight | the model without the weight   |

A fault is discrete: nothing in it is fitted, the offset apart. What can be any number (a gain, a delay, a load) is an
effect and no fault. Orientations have faults of their own (:mod:`.conventions`), and so have the clock
(:mod:`.shifts`) and parts of runs (:mod:`.outages`).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.identifiable import Identifiable

Kind = Literal["signal", "command"]
HINGE = {math.pi / 180: "degrees for radians", 180 / math.pi: "radians for degrees"}
SLIDE = {1e-3: "millimetres for metres", 1e3: "metres for millimetres"}
SENSOR = {
    math.pi / 180: "degrees for radians",
    9.80665: "multiples of g for m/s2, or kilogrammes for newtons",
    1e-3: "thousandths (such as millimetres) for the unit itself",
    1e3: "the unit itself for thousandths",
}
COMMAND = {
    -1.0: "the reversed sign",
    1e-3: "thousandths (such as millivolts) for the unit itself",
    1e3: "the unit itself for thousandths",
    0.1: "ten times too large",
    10.0: "ten times too small",
    math.pi / 180: "degrees for radians",
    180 / math.pi: "radians for degrees",
}


class Fault(ABC):
    """One hypothesis about the wiring."""

    @property
    @abstractmethod
    def says(self) -> str:
        """The fault, as the end of a sentence."""

    @property
    @abstractmethod
    def lines(self) -> str:
        """The lines to put in the problem file, as TOML; a comment where only the table can say it."""

    @property
    def smoothed_anew(self) -> bool:
        """True if the windows' starts follow from the mended table alone, not from those of the table as it stands."""
        return False

    def correct(self, measurement: Measurement) -> Measurement:
        """The measurement with the fault put right."""
        return measurement

    def model(self, simulator: Identifiable) -> Identifiable:
        """The simulator with the fault put right."""
        return simulator

    def noise(self, names: Sequence[str], noise: Float[Tensor, " S"]) -> Float[Tensor, " S"]:
        """The floor of each signal carried along [SI], so that a factor alone makes no error smaller."""
        del names
        return noise

    def started(self, windows: Windows, shown: Sequence[str]) -> Windows:
        """Windows of the table as it stands whose smoothed starts are put right; all else in them stays.

        Args:
            windows: of the table.
            shown: for each joint the signal that its start was smoothed from.
        """
        del shown
        return windows


@dataclass(frozen=True)
class AsItStands(Fault):
    """No fault: the table and the model as they are, to compare with."""

    @property
    def says(self) -> str:
        """Nothing is wrong."""
        return "nothing is wrong"

    @property
    def lines(self) -> str:
        """Nothing to write."""
        return ""


@dataclass(frozen=True)
class Rescaled(Fault):
    """Columns that must be multiplied by ``factor``; ``instead`` says what they hold."""

    kind: Kind
    names: tuple[str, ...]
    factor: float
    instead: str

    @property
    def says(self) -> str:
        """``qpos.hinge has degrees for radians``."""
        return f"{' and '.join(_column(self.kind, name) for name in self.names)}: {self.instead}"

    @property
    def lines(self) -> str:
        """``sign`` or ``scale`` under [signals] or [commands]."""
        value = "sign = -1" if self.factor == -1.0 else f"scale = {self.factor:.9g}"
        return "\n".join(f"{_header(self.kind, name)}\n{value}" for name in self.names)

    def correct(self, measurement: Measurement) -> Measurement:
        """The columns times the factor."""
        key, columns = _places(measurement, self.kind, self.names)
        data = _copy(measurement.data, key)
        data[key][..., columns] *= self.factor
        return replace(measurement, data=data)

    def noise(self, names: Sequence[str], noise: Float[Tensor, " S"]) -> Float[Tensor, " S"]:
        """The rescaled signals' floors times the size of the factor."""
        if self.kind == "command":
            return noise
        factors = [abs(self.factor) if name in self.names else 1.0 for name in names]
        return noise * noise.new_tensor(factors)

    def started(self, windows: Windows, shown: Sequence[str]) -> Windows:
        """The rescaled joints' positions and velocities, both smoothed from one signal, times the factor."""
        factors = [self.factor if signal in self.names else 1.0 for signal in shown]
        return replace(windows, start=windows.start * windows.start.new_tensor(2 * factors))


@dataclass(frozen=True)
class WholeLog(Fault):
    """Signals and commands in one other unit: a log of position servos that is in degrees throughout."""

    signals: Rescaled
    commands: Rescaled

    @property
    def says(self) -> str:
        """``qpos.hinge and ctrl.servo: degrees for radians``."""
        names = (*self.signals.names, *(_column("command", name) for name in self.commands.names))
        return f"{' and '.join(names)}: {self.signals.instead}"

    @property
    def lines(self) -> str:
        """``scale`` under [signals] and [commands]."""
        return f"{self.signals.lines}\n{self.commands.lines}"

    def correct(self, measurement: Measurement) -> Measurement:
        """Both times the factor."""
        return self.commands.correct(self.signals.correct(measurement))

    def noise(self, names: Sequence[str], noise: Float[Tensor, " S"]) -> Float[Tensor, " S"]:
        """See :meth:`Rescaled.noise` of the signals."""
        return self.signals.noise(names, noise)

    def started(self, windows: Windows, shown: Sequence[str]) -> Windows:
        """See :meth:`Rescaled.started` of the signals."""
        return self.signals.started(windows, shown)


@dataclass(frozen=True)
class Offset(Fault):
    """A position to which ``value`` must be added [SI]."""

    signal: str
    value: float

    @property
    def says(self) -> str:
        """``qpos.hinge: its zero lies elsewhere, by 1.5708``."""
        return f"{self.signal}: its zero lies elsewhere, by {self.value:.6g}"

    @property
    def lines(self) -> str:
        """``offset`` under [signals]."""
        return f"{_header('signal', self.signal)}\noffset = {self.value:.9g}"

    def correct(self, measurement: Measurement) -> Measurement:
        """The column plus the value."""
        key, columns = _places(measurement, "signal", (self.signal,))
        data = _copy(measurement.data, key)
        data[key][..., columns] += self.value
        return replace(measurement, data=data)

    def started(self, windows: Windows, shown: Sequence[str]) -> Windows:
        """The joint's position plus the value."""
        values = [self.value if self.signal == signal else 0.0 for signal in shown]
        return replace(windows, start=windows.start + windows.start.new_tensor([*values, *(0.0 for _ in shown)]))


@dataclass(frozen=True)
class Swapped(Fault):
    """Columns ``first`` that hold what belongs to ``second``, and the other way round, pair by pair."""

    kind: Kind
    first: tuple[str, ...]
    second: tuple[str, ...]

    @property
    def says(self) -> str:
        """``qpos.a and qpos.b are swapped``."""
        pairs = zip(self.first, self.second, strict=True)
        return "; ".join(f"{_column(self.kind, a)} and {_column(self.kind, b)} are swapped" for a, b in pairs)

    @property
    def lines(self) -> str:
        """``column`` of both under [signals] or [commands]."""
        pairs = [*zip(self.first, self.second, strict=True), *zip(self.second, self.first, strict=True)]
        return "\n".join(f'{_header(self.kind, a)}\ncolumn = "{_column(self.kind, b)}"' for a, b in pairs)

    def correct(self, measurement: Measurement) -> Measurement:
        """The columns exchanged, and what was measured of them."""
        names = (*self.first, *self.second)
        _, columns = _places(measurement, self.kind, names)
        sources = columns[len(self.first) :] + columns[: len(self.first)]
        keys = ("signal", "measured") if self.kind == "signal" else ("command", "enable")
        data = _copy(measurement.data, *keys)
        for moved in keys:
            data[moved][..., columns] = measurement.data[moved][..., sources]
        return replace(measurement, data=data)

    def noise(self, names: Sequence[str], noise: Float[Tensor, " S"]) -> Float[Tensor, " S"]:
        """The floors of two signals exchanged."""
        return noise if self.kind == "command" else noise[self._order(list(names))]

    def started(self, windows: Windows, shown: Sequence[str]) -> Windows:
        """The joints exchanged: where they start, and in which windows they move."""
        if self.kind == "command":
            return windows
        order = self._order(list(shown))
        both = order + [len(order) + place for place in order]
        return replace(windows, start=windows.start[:, both], free=windows.free[:, order])

    def _order(self, names: list[str]) -> list[int]:
        """For each name the place of the one that it is exchanged with."""
        partner = dict(zip((*self.first, *self.second), (*self.second, *self.first), strict=True))
        return [names.index(partner.get(name, name)) for name in names]


@dataclass(frozen=True)
class Compensated(Fault):
    """A controller that carries the weight, so that the logged commands come on top."""

    actuators: tuple[str, ...]

    @property
    def says(self) -> str:
        """Who carries the weight."""
        return f"the controller of {', '.join(self.actuators)} compensates gravity, and the table leaves that out"

    @property
    def lines(self) -> str:
        """``gravity_compensation`` of every actuator."""
        return "\n".join(f"[actuators.{_bare(name)}]\ngravity_compensation = true" for name in self.actuators)

    def model(self, simulator: Identifiable) -> Identifiable:
        """The simulator whose weight is carried."""
        return simulator.with_gravity_compensation() or simulator


def _column(kind: Kind, name: str) -> str:
    return name if kind == "signal" else f"ctrl.{name}"


def _header(kind: Kind, name: str) -> str:
    return f'[signals."{name}"]' if kind == "signal" else f"[commands.{_bare(name)}]"


def _bare(name: str) -> str:
    """A TOML key, quoted where it must be."""
    return name if name.replace("_", "").replace("-", "").isalnum() and name.isascii() else f'"{name}"'


def _places(measurement: Measurement, kind: Kind, names: Sequence[str]) -> tuple[str, list[int]]:
    """Return the leaf in which the columns stand, and their places there."""
    if kind == "command":
        return "command", [measurement.commands.index(name) for name in names]
    known = [signal.name for signal in measurement.signals]
    return "signal", [known.index(name) for name in names]


def _copy(data: TensorDict, *keys: str) -> TensorDict:
    """The data with copies of these leaves; the others are shared."""
    copy = data.clone(recurse=False)
    for key in keys:
        copy[key] = torch.clone(data[key])
    return copy
