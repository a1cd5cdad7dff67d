"""Signals that were logged on clocks of their own -> one table whose rows are the union of their instants.

    rows t_0 < t_1 < ... = all instants of the wanted columns;   cell (i, c) = value of c at t_i, nan where it has none

Nothing is interpolated and no row is dropped: a cell that was not measured stays unmeasured. ``time`` counts from the
first instant in the file, which keeps nanoseconds exact where a log's clock counts from 1970.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from onlinebayes.measurements.formats.source import MOST_COLUMNS, Columns, Source, check_cells, check_held
from onlinebayes.runs import BadInput

OTHER_CLOCK = 3600 * 1_000_000_000
"""Lateness of a message beyond which its stamp is of another clock than the log's [ns]."""


@dataclass(frozen=True)
class Series:
    """Samples of one column as they are read.

    Args:
        instants: [ns].
        values: as logged.
    """

    instants: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))


class Recorder:
    """Collects samples by column, within the bounds on columns and numbers.

    Args:
        path: the file, for messages.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.series = path, dict[str, Series]()
        self._count = 0
        self._stamped = set[str]()
        self._late: int | None = None

    def tied(self) -> dict[str, Series]:
        """The series on one clock.

        Where some have stamps of another clock than that of the others (simulated time, a device's own), more than
        ``OTHER_CLOCK`` away, stamps are moved by the smallest lateness: the message that was logged soonest.
        """
        late = self._late or 0
        if abs(late) < OTHER_CLOCK or self._stamped >= self.series.keys():
            return self.series
        return {
            name: Series(array("q", [t + late for t in one.instants]), one.values) if name in self._stamped else one
            for name, one in self.series.items()
        }

    def add(self, column: str, instant: int, value: float, late: int | None = None) -> None:
        """One sample, logged ``late`` [ns] after its stamp where it has one.

        Raises:
            BadInput: an instant beyond 64 bits, or a file that is far too large.
        """
        if (series := self.series.get(column)) is None:
            if len(self.series) == MOST_COLUMNS:
                problem = f"more than {MOST_COLUMNS} columns"
                raise BadInput(problem, "write only what was measured", where=str(self.path))
            series = self.series[column] = Series()
            if late is not None:
                self._stamped.add(column)
        self._count += 1
        if self._count % 65536 == 0:
            check_cells(2 * self._count, 1, self.path)  # an instant and a value
        try:
            series.instants.append(instant)
        except OverflowError:
            raise BadInput(
                f"a time of {instant} ns",
                "write times in nanoseconds within 292 years",
                where=f"{self.path}, '{column}'",
            ) from None
        series.values.append(value)
        if late is not None and (self._late is None or late < self._late):
            self._late = late


class SeriesSource(Source):
    """A table made of series; see the module's equation.

    Args:
        path: the file.
        series: column name -> samples; instants [ns] strictly increasing in those that are asked for.
    """

    def __init__(self, path: Path, series: Mapping[str, Series]) -> None:
        super().__init__(path, ("time", *series), joined=True)
        self._samples = {
            name: (np.frombuffer(one.instants, dtype=np.int64), np.frombuffer(one.values))
            for name, one in series.items()
        }
        self._start = min((int(instants[0]) for instants, _ in self._samples.values()), default=0)

    def columns(
        self, names: Sequence[str], text: Sequence[str] = (), held: Sequence[str] = (), exact: Sequence[str] = ()
    ) -> Columns:
        """See :meth:`Source.columns`; rows are counted from 1."""
        for name in held:
            check_held(self._samples[name][1], f"{self.path}, '{name}'")
        wanted = [name for name in names if name != "time"]
        for name in wanted:
            _check_clock(self._samples[name][0], name, self.path)
        clocks = [self._samples[name][0] for name in wanted or self._samples]
        check_cells(sum(map(len, clocks)), 1, self.path)
        rows = np.unique(np.concatenate(clocks))
        check_cells(len(rows), len(wanted), self.path)
        values: dict[str, np.ndarray] = {"time": self._seconds(rows)}
        for name in wanted:
            instants, samples = self._samples[name]
            values[name] = np.full(len(rows), np.nan)
            values[name][np.searchsorted(rows, instants)] = samples
        return Columns(values, np.arange(1, len(rows) + 1))

    def _seconds(self, rows: Int[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
        return (rows.astype(np.uint64) - np.uint64(self._start % 2**64)).astype(np.float64) / 1e9


def _check_clock(instants: Int[np.ndarray, " n"], name: str, path: Path) -> None:
    wrong = np.flatnonzero(instants[1:] <= instants[:-1])
    if wrong.size:
        k = int(wrong[0])
        raise BadInput(
            f"the time goes from {int(instants[k]) / 1e9:.9f} to {int(instants[k + 1]) / 1e9:.9f} s",
            "it must increase strictly within a file: record one run a file, each sample once",
            where=f"{path}, sample {k + 2} of '{name[:80]}'",
        )
