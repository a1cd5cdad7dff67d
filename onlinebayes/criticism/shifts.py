"""A log whose signals run ahead of its commands: a whole number of rows, which no delay can be.

    cell(t) = q(t + k h),  k = 1, 2, 3, 5, 8,  h the row step;        mended: latency = -k h of every signal

Commands that were stamped when they had been carried out, or columns joined a few rows apart. The other way round, late
signals are any number of seconds late and stand in the vocabulary (``sensor_delay``, ``actuator_delay``): whether that
is the machine's doing or the log's is said in :mod:`.log_notes`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch

from onlinebayes.criticism.faults import Fault
from onlinebayes.measurements import Measurement
from onlinebayes.measurements.latency import advanced

ROWS = (1, 2, 3, 5, 8)


@dataclass(frozen=True)
class Ahead(Fault):
    """Signals that show what happens ``rows`` rows of ``step`` [s] later."""

    signals: tuple[str, ...]
    rows: int
    step: float

    @property
    def seconds(self) -> float:
        """By how much they run ahead [s]."""
        return self.rows * self.step

    @property
    def says(self) -> str:
        """``the signals run 0.03 s (3 rows) ahead of the commands``."""
        return f"the signals run {self.seconds:g} s ({self.rows} row{'s' * (self.rows > 1)}) ahead of the commands"

    @property
    def lines(self) -> str:
        """``latency`` of every signal."""
        return "\n".join(f'[signals."{name}"]\nlatency = {-self.seconds:g}' for name in self.signals)

    @property
    def smoothed_anew(self) -> bool:
        """Positions and velocities of other instants."""
        return True

    def mended(self, measurement: Measurement) -> Measurement:
        """The columns put back to when they happened; a run's first rows are then not measured."""
        known = [signal.name for signal in measurement.signals]
        data = measurement.data.clone(recurse=False)
        data["signal"], data["measured"] = data["signal"].clone(), data["measured"].clone()
        for r, rows in enumerate(measurement.lengths.tolist()):
            time = data["time"][r, :rows].cpu().numpy()
            for s in (known.index(name) for name in self.signals):
                values = torch.where(data["measured"][r, :rows, s], data["signal"][r, :rows, s], torch.nan)
                moved = torch.as_tensor(advanced(time, values.cpu().numpy(), -self.seconds)).to(values)
                seen = torch.isfinite(moved)
                data["measured"][r, :rows, s] = seen
                data["signal"][r, :rows, s] = torch.where(seen, moved, torch.zeros_like(moved))
        return replace(measurement, data=data)


def shifts(measurement: Measurement) -> Iterator[Ahead]:
    """Every such shift of all signals together that leaves most of the shortest run."""
    names = tuple(signal.name for signal in measurement.signals)
    rows = int(measurement.lengths.min())
    step = float(measurement.data["time"][0, : int(measurement.lengths[0])].diff().median())
    for count in ROWS:
        if 4 * count < rows:
            yield Ahead(names, count, float(f"{step:.9g}"))
