"""A table's clock -> seconds: unit, a second column, a counter that wraps, an offset; an epoch keeps its nanoseconds.

    instant i = scale cell_i + rest_scale rest_i + period (wraps before i) + offset        [s]
    time_i    = instant i - origin,   subtracted as whole nanoseconds where all cells are whole numbers

float64 has 53 bits: nanoseconds since 1970 take 61, so that they are subtracted before they are converted. ROS 2 writes
an instant in two columns, ``sec`` and ``nanosec``. A counter of 16 or 32 bits begins again at its end; it is put
straight where it falls by a power of two, less the step of some rows, and has never been beyond it.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from onlinebayes.measurements.checks import check_instants
from onlinebayes.measurements.formats import Columns, Source
from onlinebayes.measurements.mapping import TimeColumn
from onlinebayes.runs import BadInput

RUN, TIME = "run", "time"
FAR = 1e6
"""From this on an instant is counted from the table's first second [s]; below, messages show it as it was written."""
COUNTER_BITS = (16, 24, 31, 32)
MOST_LOST = 100
"""Typical steps by which a counter may have gone on when it is next seen after its end; an eighth of it at most."""
NANOSECOND_WORDS = ("nanosec", "nsec", "nanos", "nanosecs", "nanoseconds", "nsecs")
FLOAT32_EXACT = 2.0**24


class TimedSource(Source):
    """A table with a column ``time`` [s], whatever its clock.

    Args:
        path, names, joined: see :class:`Source`; ``time`` is among the names.
        clock: what messages call the clock's column.
    """

    def __init__(self, path: Path, names: Sequence[str], clock: str, *, joined: bool = False) -> None:
        super().__init__(path, names, joined=joined)
        self.clock = clock

    @property
    @abstractmethod
    def wraps(self) -> tuple[tuple[str, float], ...]:
        """Counters that began again in what was read: the clock's column, and where it begins again [cells]."""


@final
class OnClock(TimedSource):
    """One table on its clock; see the module's equation. A column that only is called ``time`` is left out.

    Args:
        source: the table.
        clock: its clock.
        origin: whole seconds from which ``time`` counts; the table's own first second by default where that is far
            from 0.

    Raises:
        BadInput: a column of the clock is not there, or names the runs.
    """

    def __init__(self, source: Source, clock: TimeColumn, origin: int | None = None) -> None:
        for column in clock.columns:
            if column not in source.names:
                raise BadInput(f"no column '{column}'", _there(column, source), where=f"{source.path}, row 1")
        if RUN in clock.columns:
            cure = "name the column of the clock, or call the column of numbers otherwise"
            raise BadInput("'run' names the runs, and is no number", cure, where=f"{source.path}, row 1, column 'run'")
        kept = [name for name in source.names if name not in (TIME, *clock.columns)]
        super().__init__(source.path, (TIME, *kept), clock.column, joined=source.joined)
        self.source, self.column, self.origin = source, clock, origin
        self._read: _Instants | None = None

    @property
    def instants(self) -> _Instants:
        """The instants of all rows, read once.

        Raises:
            BadInput: cells that are no instants.
        """
        if self._read is None:
            text = [RUN] if RUN in self.source.names else []
            read = self.source.columns([*self.column.columns, *text], text, exact=self.column.columns)
            self._read = _instants(read, self.source, self.column)
        return self._read

    @property
    def wraps(self) -> tuple[tuple[str, float], ...]:
        """See :attr:`TimedSource.wraps`."""
        return ((self.clock, self._read.wraps),) if self._read is not None and self._read.wraps else ()

    @property
    def span(self) -> tuple[float, float]:
        """First and last instant [s]."""
        low, high = self.instants.ends
        return low, high

    def counted_from(self, origin: int) -> OnClock:
        """The same table with another origin [s]; nothing is read again."""
        other = OnClock(self.source, self.column, origin)
        other._read = self._read
        return other

    def columns(
        self, names: Sequence[str], text: Sequence[str] = (), held: Sequence[str] = (), exact: Sequence[str] = ()
    ) -> Columns:
        """See :meth:`Source.columns`; ``time`` is [s] from the origin."""
        others = [name for name in names if name != TIME]
        if self._read is not None and others and not self.source.joined:
            read = self.source.columns(others, text, held, exact)
            return self._with_time(read, others, self._read)
        named = [RUN] if RUN in self.source.names else []
        wanted = [*dict.fromkeys((*self.column.columns, *others, *named))]
        read = self.source.columns(wanted, sorted({*text, *named}), held, (*exact, *self.column.columns))
        instants = _instants(read, self.source, self.column)
        if not self.source.joined:  # else its rows are the instants of the columns that were asked for
            self._read = instants
        return self._with_time(read, others, instants)

    def _with_time(self, read: Columns, names: Sequence[str], instants: _Instants) -> Columns:
        return Columns({TIME: self._since(instants), **{name: read[name] for name in names}}, read.rows, read.switches)

    def _since(self, instants: _Instants) -> Float[np.ndarray, " T"]:
        origin = self.origin
        if origin is None:
            first = instants.ends[0]
            origin = int(first // 1) if abs(first) >= FAR else 0
        return instants.since(origin)


@final
class _Instants:
    """Instants of a table's rows, as whole nanoseconds or as seconds.

    Args:
        values: (T,) int64 [ns], or float64 [s].
        rows: (T,) numbers of the rows.
        wraps: period of the counter [cells], 0 where it does not wrap.
    """

    def __init__(self, values: np.ndarray, rows: Int[np.ndarray, " T"], wraps: float) -> None:
        self._values, self.rows, self.wraps = values, rows, wraps

    @property
    def ends(self) -> tuple[float, float]:
        """Smallest and largest instant [s]; nan where there is none."""
        known = self._values[np.isfinite(self._values)]
        if not known.size:
            return float("nan"), float("nan")
        scale = 1e9 if known.dtype.kind == "i" else 1.0
        return float(known.min()) / scale, float(known.max()) / scale

    def since(self, origin: int) -> Float[np.ndarray, " T"]:
        """Seconds from ``origin`` [s]."""
        if self._values.dtype.kind == "i":
            return (self._values - origin * 1_000_000_000).astype(np.float64) / 1e9
        return self._values - origin if origin else self._values


def _instants(read: Columns, source: Source, clock: TimeColumn) -> _Instants:
    cells = read[clock.column]
    same = np.ones(max(len(cells) - 1, 0), dtype=bool)
    if RUN in read:
        same = read[RUN][1:] == read[RUN][:-1]
    where = str(source.path)
    check_instants(cells * clock.scale, where, read.rows, clock.column)
    cells, wraps = unwrapped(cells, same, clock.scale)
    if not clock.rest:
        _check_resolution(cells, same, clock, source)
        return _Instants(_nanoseconds(cells, clock.scale, clock.offset), read.rows, wraps)
    rest = read[clock.rest]
    whole = _nanoseconds(cells, clock.scale, clock.offset)
    part = _nanoseconds(rest, clock.rest_scale, 0.0)
    if whole.dtype.kind != part.dtype.kind:
        whole, part = (one / 1e9 if one.dtype.kind == "i" else one for one in (whole, part))
    return _Instants(whole + part, read.rows, wraps)


def _nanoseconds(cells: np.ndarray, scale: float, offset: float) -> np.ndarray:
    """Cells as int64 [ns] where they are whole numbers of whole nanoseconds, else as float64 [s]."""
    per = round(scale * 1e9)
    small = cells.dtype.kind == "i" and (not cells.size or np.abs(cells.astype(float)).max() * per < 9e18)
    if small and per > 0 and abs(per - scale * 1e9) < 1e-6:
        return cells.astype(np.int64) * per + round(offset * 1e9)
    return cells * scale + offset if offset else cells * scale


def unwrapped(cells: np.ndarray, same: Bool[np.ndarray, " steps"], scale: float = 1.0) -> tuple[np.ndarray, float]:
    """A counter that wraps, put straight, and its period [cells]; the cells as they are and 0 where it does not.

    Args:
        cells: (T,) of the clock.
        same: whether a row and the next are of one run.
        scale: seconds in a cell [s]; counters of micro- and milliseconds may have been written in seconds.
    """
    steps = np.diff(cells)
    falls = (steps < 0) & same
    rises = steps[(steps > 0) & same]
    if not falls.any() or not rises.size:
        return cells, 0.0
    lost = MOST_LOST * float(np.median(rises))
    low, high = float(cells.min()), float(cells.max())
    for tick in dict.fromkeys((1.0, *(unit / scale for unit in (1e-6, 1e-3) if cells.dtype.kind == "f"))):
        for bits in COUNTER_BITS:
            period = 2.0**bits * tick
            inside = (low >= 0 and high < period) or (low >= -period / 2 and high < period / 2)
            gone_on = steps[falls] + period
            if inside and bool(((gone_on > 0) & (gone_on <= min(lost, period / 8))).all()):
                wraps = np.concatenate([[0], np.cumsum(falls)])
                return cells + (wraps * int(period) if cells.dtype.kind == "i" else wraps * period), period
    return cells, 0.0


def _check_resolution(cells: np.ndarray, same: Bool[np.ndarray, " steps"], clock: TimeColumn, source: Source) -> None:
    """Raise :class:`BadInput` where rows share an instant because the clock's column cannot tell them apart."""
    steps = np.diff(cells)
    still, rises = (steps == 0) & same, steps[(steps > 0) & same]
    if not still.any():
        return
    where = f"{source.path}, row {np.flatnonzero(still)[0] + 3}, column '{clock.column}'"
    largest = float(np.abs(cells).max())
    finest = float(np.spacing(np.float32(largest)))
    coarse = rises.min() < 4 * finest if rises.size else largest >= FLOAT32_EXACT
    shared = f"{int(still.sum())} rows have the instant of the row before"
    rest = [name for name in source.names if name != clock.column and name.lower().endswith(NANOSECOND_WORDS)]
    if rest:
        cure = f"the rest of each second seems to stand in '{rest[0]}': [time] column = \"{clock.column}\", "
        raise BadInput(shared, f'{cure}rest = "{rest[0]}"', where=where)
    if coarse and bool((np.float32(cells) == cells).all()):
        raise BadInput(
            f"{shared}: a float32 near {largest:.10g} has steps of {finest * clock.scale:g} s, which is no clock",
            "log it in float64 or as whole nanoseconds, or count it from the start of the run",
            where=where,
        )


def _there(column: str, source: Source) -> str:
    few = ", ".join(f"'{name}'" for name in source.names[:12])
    return f"the table has {few}; name its clock in the problem file: [time] column"
