"""Columns of a log that lie a whole number of rows from where they belong.

    all signals ahead of the commands    cell(t) = q(t + k h),  k = 1, 2, 3, 5, 8     latency = -k h of every signal
    sensors ahead of all other signals   cell(t) = s(t + h)                           latency = -h of the sensors
    one column a row from the others     cell(t) = s(t + h), s(t - h)                 latency = -h, h of that signal
    all signals after the commands       cell(t) = q(t - h)                           latency = h of every signal

with h the row step. A sensor of force or acceleration that is read under the row's own command, not before it is sent,
shows what the model gives a row later. Ahead run commands that were stamped when they had been carried out, and columns
joined a few rows apart; no effect does that. Late signals are in the vocabulary of effects (``sensor_delay``): they are
looked for here only where no effect is tried. Position and velocity of a joint are shifted together, and each alone.
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
    """Signals that show what happened ``rows`` rows of ``step`` [s] before; negative, what happens that much later.

    Args:
        signals: names.
        rows, step: by how much they are late.
        every: whether these are all signals: nothing but the commands tells that they are shifted.
    """

    signals: tuple[str, ...]
    rows: int
    step: float
    every: bool = False

    @property
    def seconds(self) -> float:
        """By how much they are late [s]."""
        return self.rows * self.step

    @property
    def says(self) -> str:
        """``the signals run 0.03 s (3 rows) ahead of the commands``, ``qpos.elbow is logged 0.035 s (7 rows) late``."""
        size = f"{abs(self.seconds):g} s ({abs(self.rows)} row{'s' * (abs(self.rows) > 1)})"
        if self.rows < 0 and self.every:
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


def shifts(measurement: Measurement, commanded: bool, late: bool) -> Iterator[Shifted]:
    """Every such shift that leaves most of the shortest run.

    Args:
        measurement: gives the signals and their rows.
        commanded: whether there are commands, against which all signals may be shifted.
        late: whether signals may be late.
    """
    names = tuple(signal.name for signal in measurement.signals)
    sensors, rows = tuple(filter(is_sensor, names)), int(measurement.lengths.min())
    step = _row_step(measurement)
    if rows <= 4:
        return
    if 0 < len(sensors) < len(names):
        yield Shifted(sensors, -1, step)
    if commanded:
        yield from (Shifted(names, -count, step, every=True) for count in ROWS if 4 * count < rows)
    signs = (-1, 1) if late else (-1,)
    yield from (Shifted(some, sign, step) for sign in signs for some in _columns(names))
    if late and commanded:
        yield Shifted(names, 1, step, every=True)


def _columns(names: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """Each joint's position and velocity together, then each alone; never all of the signals."""
    for name in names:
        both = (name, name.replace("qpos.", "qvel.", 1))
        if both[1] != name and both[1] in names and len(names) > 2:
            yield both
    yield from ((name,) for name in names if len(names) > 1 and not is_sensor(name))


def is_sensor(signal: str) -> bool:
    """Check whether a signal is given by a sensor of the model, which may jump with the command."""
    return signal.startswith(("sensor.", "qfrc."))


def _row_step(measurement: Measurement) -> float:
    step = float(measurement.data["time"][0, : int(measurement.lengths[0])].diff().median())
    return float(f"{step:.9g}")
