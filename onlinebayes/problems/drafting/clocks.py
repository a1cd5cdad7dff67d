"""The clock of every log: by its name, in two columns (``sec``, ``nanosec``), or the only column that rises.

The unit is the name's; without one it is that of the epoch that the numbers count from, else the one in which a log has
between 1 and 1000 rows a second. Logs with no column in common are topics of one recording where their clocks overlap;
where these do not, nothing ties them, and the draft says what to write.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from onlinebayes.measurements import TimeColumn
from onlinebayes.measurements.clocks import RUN, OnClock, TimedSource
from onlinebayes.measurements.formats import Source
from onlinebayes.measurements.joining import JoinedSource, Untied, joined, name_of, untied
from onlinebayes.measurements.units import to_si
from onlinebayes.problems.drafting.matching import CLOCK, SECONDS, Match, match_time, words
from onlinebayes.runs import BadInput

LONGEST_STEP = {"s": 1.0, "ms": 1e3, "us": 1e6}
"""Units of a clock, each with the step of a log of one row a second."""
EPOCH = {"s": 1e9, "ms": 1e12, "us": 1e15, "ns": 1e18}
"""Units of a clock, each with what it shows in 2001; in 2096 it shows four times as much."""
COUNTERS = {"tick", "ticks"}
RESTS = {"ns": ("nanosec", "nanosecs", "nsec", "nsecs", "nanos", "nanosecond", "nanoseconds"), "us": ("usec", "usecs")}
"""Words for the rest of a second."""
WHOLE = ("sec", "secs", "second", "seconds")


@dataclass(frozen=True)
class Clock:
    """A log's clock.

    Args:
        column: of the log.
        unit: of the column; empty for seconds.
        rest: the column of the rest of each second; empty where there is none.
        rest_unit: its unit.
        why: it was proposed.
    """

    column: str
    unit: str = ""
    rest: str = ""
    rest_unit: str = "ns"
    why: str = Match.why

    @property
    def exact(self) -> bool:
        """True if it needs no line in the problem file."""
        return self.column == "time" and not self.unit and not self.rest

    @property
    def time_column(self) -> TimeColumn:
        """The same for a reader of tables."""
        return TimeColumn(self.column, to_si(self.unit or "s"), self.rest, to_si(self.rest_unit))

    @property
    def match(self) -> Match:
        """The same as a match of ``time``."""
        return Match("time", self.column + (f" + {self.rest}" if self.rest else ""), self.unit, self.why)

    @property
    def table(self) -> dict[str, str]:
        """The same as a table of the problem file."""
        found = {"column": self.column, "unit": self.unit or "s"}
        if self.rest:
            found |= {"rest": self.rest} | ({"rest_unit": self.rest_unit} if self.rest_unit != "ns" else {})
        return found


def clock_of(source: Source) -> Clock | None:
    """The clock of a log; None where none is clear."""
    if "time" not in source.names and (pair := _pair(source.names)):
        return pair
    if named := match_time(source.names):
        clock = Clock(named.column, named.unit)
        if clock.unit:
            return clock
        unit = _unit(source, clock.column)
        return clock if clock.exact and unit == "s" else replace(clock, unit=unit)
    said = CLOCK | SECONDS.keys() | COUNTERS
    like = [name for name in source.names if name != RUN and said & {*words(name)} and is_clock(source, name)]
    if len(like) != 1 or not {*words(like[0])} & (SECONDS.keys() - {"s"} | CLOCK - {"t", "start", "since"}):
        return None
    units = [SECONDS[word] for word in words(like[0]) if word in SECONDS]
    why = "a guess, it alone rises in every row"
    return Clock(like[0], units[-1] if units else _unit(source, like[0]), why=why)


def timed(sources: Sequence[Source], clocks: Sequence[Clock]) -> tuple[list[TimedSource], list[str]]:
    """The logs on their clocks, those of one run joined, and what is to be said where nothing ties two clocks.

    Args:
        sources: the logs.
        clocks: of each.
    """
    on = [OnClock(source, clock.time_column) for source, clock in zip(sources, clocks, strict=True)]
    try:
        tables = joined(on)
        if len(tables) == 1 and isinstance(tables[0], JoinedSource):
            tables[0].columns(["run", "time"], ["run"])
        if (doubt := untied(tables)) is None:
            return tables, []
    except Untied as error:
        doubt = error
    return [_begun_together(on)], [str(doubt)]


def is_clock(source: Source, column: str) -> bool:
    """Check whether the numbers of a column rise in every row, but where a run begins or a counter ends."""
    steps = _steps(source, column)
    return len(steps) > 0 and float(np.mean(steps > 0)) > 0.99


def rises(source: Source, column: str) -> bool:
    """Check whether a column could be a clock: numbers that rise in nearly every row."""
    steps = _steps(source, column)
    return len(steps) > 0 and float(np.mean(steps > 0)) > 0.9


def _begun_together(sources: Sequence[OnClock]) -> JoinedSource:
    """The logs as if each began when the first did, so that their columns can be matched."""
    first = sources[0].span[0]
    moved = [
        OnClock(one.source, replace(one.column, offset=one.column.offset + first - one.span[0])) for one in sources
    ]
    return JoinedSource(moved, name_of(sources))


def _pair(names: Sequence[str]) -> Clock | None:
    """The two columns that are the whole seconds and the rest of them; None where several are."""
    found = []
    for whole in names:
        *before, last = words(whole) or [""]
        for unit, rests in RESTS.items():
            rest = [
                name for name in names if words(name)[:-1] == before and words(name)[-1:] and words(name)[-1] in rests
            ]
            if last in WHOLE and len(rest) == 1:
                found.append(Clock(whole, "s", rest[0], unit))
    stamps = [one for one in found if {*words(one.column)} <= {"header", "stamp", "field", *WHOLE}] or found
    return stamps[0] if len(stamps) == 1 else None


def _unit(source: Source, column: str) -> str:
    ticks = source.columns([column])[column]
    if len(ticks) and (epoch := [unit for unit, low in EPOCH.items() if low <= abs(ticks[0]) < 4 * low]):
        return epoch[0]
    step = float(np.median(np.abs(np.diff(ticks)))) if len(ticks) > 1 else 1.0
    return next((unit for unit, longest in LONGEST_STEP.items() if step <= longest), "ns")


def _steps(source: Source, column: str) -> np.ndarray:
    named = [RUN] if RUN in source.names else []
    try:
        read = source.columns([column, *named], named)
    except BadInput:
        return np.zeros(0)
    steps = np.diff(read[column])
    return steps[read[RUN][1:] == read[RUN][:-1]] if named else steps
