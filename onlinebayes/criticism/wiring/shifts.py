"""Columns of a log that lie a whole number of rows from where they belong.

    all signals ahead of the commands    cell(t) = q(t + k h),  k = 1, 2, 3, 5, 8     latency = -k h of every signal
    sensors ahead of all other signals   cell(t) = s(t + h)                           latency = -h of the sensors
    one joint's signals late             cell(t) = q(t - k h),  k = 2, 3, ...         latency = k h of these

with h the row step. A sensor of force or acceleration that is read under the row's own command, not before it is sent,
shows what the model gives a row later. Ahead run commands that were stamped when they had been carried out, and columns
joined a few rows apart; no effect does that. Late signals stand in the vocabulary too (``sensor_delay``): a delay is
the log's where it is two rows or more to a twentieth of a row, for a buffer is late by rows and a sensor by any time. A
joint's are looked for before any effect is tried (:mod:`.late_columns`), and where delays were accepted. Delays that
leave more than noise are not known to a twentieth: the nearest row is tried, and has to do better. Where all signals
are late alike, or a motor's delay explains as much, nothing says whose it is: see :mod:`.findings.log_notes`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from onlinebayes.criticism.wiring.faults import Fault
from onlinebayes.identification.data.latency import without_latency
from onlinebayes.measurements import Measurement

ROWS = (1, 2, 3, 5, 8)
FEWEST_ROWS = 2
WHOLE = 0.05  # rows


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

    def mended(self, measurement: Measurement) -> Measurement:
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


def late_joints(measurement: Measurement) -> Iterator[Shifted]:
    """Every joint's signals late by several rows, where another joint's are not."""
    names, rows = [signal.name for signal in measurement.signals], int(measurement.lengths.min())
    for joint in dict.fromkeys(map(_joint, names)):
        own = tuple(name for name in names if _joint(name) == joint)
        for count in ROWS:
            if FEWEST_ROWS <= count < rows / 4 and len(own) < len(names):
                yield Shifted(own, count, _row_step(measurement))


def late(measurement: Measurement, delays: Mapping[str, float], loosely: bool = False) -> Shifted | None:
    """The fault of the log that accepted sensor delays are; None where they may be the sensors' own.

    Args:
        measurement: the runs.
        delays: position or velocity signal -> its delay [s], of every accepted effect.
        loosely: whether they leave more than noise, and are known no better than to a row therefore.
    """
    names, step = [signal.name for signal in measurement.signals], _row_step(measurement)
    joints = {_joint(name) for name in delays}
    signals = tuple(name for name in names if _joint(name) in joints)
    if len(joints) != 1 or len(signals) == len(names):
        return None
    if loosely:
        rows, whole = {round(sum(delays.values()) / len(delays) / step)}, True
    else:
        rows = {round(delay / step) for delay in delays.values()}
        whole = all(abs(delay / step - round(delay / step)) <= WHOLE for delay in delays.values())
    return Shifted(signals, rows.pop(), step) if whole and len(rows) == 1 and min(rows) >= FEWEST_ROWS else None


def is_sensor(signal: str) -> bool:
    """Whether a signal is what a sensor of the model gives, which may jump with the command."""
    return signal.startswith(("sensor.", "qfrc."))


def _joint(signal: str) -> str:
    return signal.partition(".")[2]


def _row_step(measurement: Measurement) -> float:
    step = float(measurement.data["time"][0, : int(measurement.lengths[0])].diff().median())
    return float(f"{step:.9g}")
