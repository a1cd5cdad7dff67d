"""Columns of a log that lie a whole number of rows from where they belong.

    all signals ahead of the commands    cell(t) = q(t + k h),  k = 1, 2, 3, 5, 8     latency = -k h of every signal
    sensors ahead of all other signals   cell(t) = s(t + h)                           latency = -h of the sensors

with h the row step. A sensor of force or acceleration that is read under the row's own command, not before it is sent,
shows what the model gives a row later. Ahead run commands that were stamped when they had been carried out, and columns
joined a few rows apart; no effect does that. Late signals are in the vocabulary of effects (``sensor_delay``).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from onlinebayes.criticism.wiring.faults import Fault
from onlinebayes.identification.data.latency import without_latency
from onlinebayes.measurements import Measurement

ROWS = (1, 2, 3, 5, 8)


@dataclass(frozen=True)
class Shifted(Fault):
    """Signals that show what happened ``rows`` rows of ``step`` [s] before; negative, what happens that much later."""

    signals: tuple[str, ...]
    rows: int
    step: float

    @property
    def seconds(self) -> float:
        """By how much they are late [s]."""
        return self.rows * self.step

    @property
    def says(self) -> str:
        """``the signals run 0.03 s (3 rows) ahead of the commands``, ``qpos.elbow is logged 0.035 s (7 rows) late``."""
        size = f"{abs(self.seconds):g} s ({abs(self.rows)} row{'s' * (abs(self.rows) > 1)})"
        if self.rows < 0 and not all(map(is_sensor, self.signals)):
            return f"the signals run {size} ahead of the commands"
        is_or_are = "is" if len(self.signals) == 1 else "are"
        return f"{' and '.join(self.signals)} {is_or_are} logged {size} {'late' if self.rows > 0 else 'early'}"

    @property
    def lines(self) -> str:
        """``latency`` of these signals."""
        return "\n".join(f'[signals."{name}"]\nlatency = {self.seconds:g}' for name in self.signals)

    @property
    def smoothed_anew(self) -> bool:
        """Positions and velocities of other instants."""
        return True

    def correct(self, measurement: Measurement) -> Measurement:
        """The columns put back to when they happened; the rows at a run's end without a value are not measured."""
        return without_latency(measurement, dict.fromkeys(self.signals, self.seconds))


def shifts(measurement: Measurement) -> Iterator[Shifted]:
    """Every such shift of all signals together that leaves most of the shortest run, and a row's of the sensors."""
    names = tuple(signal.name for signal in measurement.signals)
    sensors, rows = tuple(filter(is_sensor, names)), int(measurement.lengths.min())
    if 0 < len(sensors) < len(names) and rows > 4:
        yield Shifted(sensors, -1, _row_step(measurement))
    for count in ROWS:
        if 4 * count < rows:
            yield Shifted(names, -count, _row_step(measurement))


def is_sensor(signal: str) -> bool:
    """Check whether a signal is given by a sensor of the model, which may jump with the command."""
    return signal.startswith(("sensor.", "qfrc."))


def _row_step(measurement: Measurement) -> float:
    step = float(measurement.data["time"][0, : int(measurement.lengths[0])].diff().median())
    return float(f"{step:.9g}")
