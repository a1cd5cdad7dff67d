"""Maps from a column of a log to a quantity of the model: value = scale cell + offset, sign and units in the scale.

A command may be the product of two columns: a duty cycle and the supply's voltage are together the volts at a motor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from onlinebayes.measurements.measurement import Signal


@dataclass(frozen=True)
class TimeColumn:
    """The column that holds the clock, or the two columns.

    Args:
        column: the table's column.
        scale: seconds in one of its units [s].
        rest: the column of what has passed since that instant (ROS writes ``sec`` and ``nanosec``); none by default.
        rest_scale: seconds in one of the units of ``rest`` [s].
        offset: what is added, where the clocks of two tables differ [s].
    """

    column: str = "time"
    scale: float = 1.0
    rest: str = ""
    rest_scale: float = 1e-9
    offset: float = 0.0

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns that it is read from."""
        return (self.column, self.rest) if self.rest else (self.column,)


SECONDS = TimeColumn()
"""The contract's clock: ``time`` [s]."""


@dataclass(frozen=True)
class SignalColumn:
    """A signal and the column that it comes from.

    Args:
        signal: the model's signal, with its noise.
        column: the table's column; the signal's own name by default.
        scale: what multiplies the cell, units and sign included [unit of the signal / unit of the column].
        offset: what is added then [unit of the signal].
        latency: seconds by which the column lags (see :mod:`.latency`) [s].
        period: by which the signal jumps where the column was wrapped (2 pi for an angle within -pi to pi); each
            cell is moved by whole periods to the nearest to the one before it [unit of the signal].
    """

    signal: Signal
    column: str = ""
    scale: float = 1.0
    offset: float = 0.0
    latency: float = 0.0
    period: float | None = None

    @property
    def source(self) -> str:
        """Name of the column in the table."""
        return self.column or self.signal.name

    def value(self, cells: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
        """The signal [SI]; what overflows is infinite, which the checks refuse."""
        with np.errstate(over="ignore"):
            value = cells * self.scale + self.offset
        if self.period is not None:
            known = np.isfinite(value)
            value[known] = np.unwrap(value[known], period=self.period)
        return value


@dataclass(frozen=True)
class CommandColumn:
    """An actuator's command and the column that it comes from.

    Args:
        actuator: the model's actuator.
        column: the table's column; ``ctrl.<actuator>`` by default, of a measured wrench its own name.
        scale: what multiplies the cell, units and sign included [command unit / unit of the column].
        offset: what is added then [command unit].
        enable: the column that is 0 while the actuator is off; ``enable.<actuator>`` by default.
        times: the column by whose cells the command's are multiplied; none by default.
    """

    actuator: str
    column: str = ""
    scale: float = 1.0
    offset: float = 0.0
    enable: str = ""
    times: str = ""

    @property
    def source(self) -> str:
        """Name of the column in the table."""
        return self.column or (self.actuator if self.measured else f"ctrl.{self.actuator}")

    @property
    def measured(self) -> bool:
        """True for a wrench from outside, ``xfrc.<body>.<axis>``, which was measured and not commanded."""
        return self.actuator.startswith("xfrc.")

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of all columns that it is read from."""
        return (self.source, self.times) if self.times else (self.source,)

    def value(self, *cells: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
        """The command from the cells of its sources [command unit]; what overflows is infinite, which checks refuse."""
        with np.errstate(over="ignore", invalid="ignore"):
            return np.prod(cells, axis=0) * self.scale + self.offset
