"""Tables that hold the same runs, each with some of their columns -> one table.

    rows of a run t_0 < t_1 < ... = all its instants in the tables that hold it
    cell (i, c) = what the table with column c has at t_i, empty where it has no row then

Nothing is interpolated: signals have cells that were not measured, commands hold their last value, as in any table.
Tables that share a run share its clock. A log that counts time from its own first sample shares it with none.
Tables without names of runs and without a column in common, on clocks that overlap, are the topics of one recording.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, takewhile
from pathlib import Path
from typing import final

import numpy as np

from onlinebayes.measurements.checks import check_time
from onlinebayes.measurements.clocks import FAR, RUN, TIME, OnClock, TimedSource
from onlinebayes.measurements.formats import Columns
from onlinebayes.measurements.stretches import check_rises, run_rows
from onlinebayes.runs import BadInput

PARTS = re.compile(r"([_\-. ]+)")
"""Between the words of a file's name."""
LEAST_OVERLAP = 0.5
"""Share of the shorter table's time in which the tables of one recording overlap."""


class Untied(BadInput):
    """The clocks of two tables of one run do not overlap."""


def joined(sources: Sequence[OnClock]) -> list[TimedSource]:
    """The tables, each group that shares runs as one; those of the same columns stand alone, whatever runs they hold.

    Args:
        sources: each on its clock.

    Raises:
        BadInput: a table's runs cannot be read, or share no clock with another table's.
    """
    if len({frozenset(source.names) for source in sources}) < 2:
        return list(sources)
    groups: list[tuple[list[OnClock], set[str]]] = []
    for source in sources:
        own = _runs_of(source)
        others = [group for group in groups if group[1] & own]
        groups = [group for group in groups if group not in others]
        members = [*(member for group in others for member in group[0]), source]
        groups.append((members, own.union(*(runs for _, runs in others))))
    found: list[TimedSource] = []
    alone = [group[0][0] for group in groups if len(group[0]) == 1]
    topics = topics_of(alone)
    for members, _ in groups:
        together = next((one for one in topics if members[0] in one), members)
        if len(together) == 1:
            found.append(members[0])
        elif members[0] is together[0]:
            found.append(JoinedSource(together, "" if together is members else name_of(together)))
    return found


def topics_of(sources: Sequence[OnClock]) -> list[list[OnClock]]:
    """The tables that are the topics of one recording, by recording; none that could be of several."""
    free = [source for source in sources if RUN not in source.names and not source.joined]
    tied = {(a, b) for a, b in combinations(free, 2) if are_parts(a, b) and _overlap(a, b)}
    groups: list[list[OnClock]] = []
    for source in free:
        near = [other for other in free if (source, other) in tied or (other, source) in tied]
        group = [other for other in free if other is source or other in near]
        whole = all((a, b) in tied for a, b in combinations(group, 2))
        if whole and len(group) > 1 and group not in groups:
            groups.append(group)
    return [group for group in groups if sum(bool({*group} & {*other}) for other in groups) == 1]


def are_parts(a: OnClock, b: OnClock) -> bool:
    """Check whether two tables have no column in common but their clocks."""
    return not {*a.names} & {*b.names} - {TIME}


def name_of(parts: Sequence[OnClock]) -> str:
    """The name of the run whose topics some tables are: what their files' names begin with, else all of these."""
    stems = [part.path.stem for part in parts]
    begun = takewhile(lambda words: len({*words}) == 1, zip(*(re.split(PARTS, stem) for stem in stems), strict=False))
    return "".join(words[0] for words in begun).rstrip("_-. ") or "+".join(stems)


@final
class JoinedSource(TimedSource):
    """Several tables as one; see the module's equation. Rows are counted from 1 in each run.

    Args:
        parts: two tables or more.
        run: name of the run that tables without names of runs hold; their files' by default.

    Raises:
        BadInput: a table that counts time from its own first sample.
    """

    def __init__(self, parts: Sequence[OnClock], run: str = "") -> None:
        if alone := [part for part in parts if part.joined]:
            others = ", ".join(str(part.path) for part in parts if part is not alone[0])
            raise BadInput(
                f"holds a run of {others}, but counts time from its own first sample: nothing ties the two clocks",
                "record both into one log, convert it to a table with the clock of the other, or rename the run",
                where=str(alone[0].path),
            )
        names = dict.fromkeys([RUN, *(name for part in parts for name in part.names)])
        # On clocks of their own: a run may begin before its first command was sent.
        path = Path(" + ".join(str(part.path) for part in parts))
        super().__init__(path, tuple(names), parts[0].clock, joined=True)
        starts = [part.span[0] for part in parts]
        origin = int(min(starts) // 1) if max(starts) >= FAR else 0
        self.parts, self.run = tuple(part.counted_from(origin) for part in parts), run

    @property
    def wraps(self) -> tuple[tuple[str, float], ...]:
        """See :attr:`TimedSource.wraps`."""
        return tuple(wraps for part in self.parts for wraps in part.wraps)

    def columns(
        self, names: Sequence[str], text: Sequence[str] = (), held: Sequence[str] = (), exact: Sequence[str] = ()
    ) -> Columns:
        """See :meth:`Source.columns`.

        Raises:
            BadInput: of the tables themselves, a column that two tables have of one run, or clocks that do not overlap.
        """
        runs: dict[str, list[_Piece]] = {}
        switches: set[str] = set()
        for part in self.parts:
            own = {*names, RUN, TIME} & {*part.names}
            read = part.columns(sorted(own), sorted({*text, RUN} & own), sorted({*held} & own), exact)
            switches |= read.switches
            check_rises(read[TIME], part.clock, read, part)
            named = run_rows(read, part.path)
            if self.run and RUN not in part.names:
                named = {self.run: slice(0, len(read.rows))}
            for run, rows in named.items():
                piece = {name: read[name][rows] for name in own if name != RUN}
                check_time(piece[TIME], str(part.path), read.rows[rows], part.clock)
                runs.setdefault(run, []).append(_Piece(part, piece))
        for run, pieces in runs.items():
            _check_overlap(run, pieces)
        tables = [self._one_run(run, pieces, names) for run, pieces in runs.items()]
        values = {name: np.concatenate([table[name] for table in tables]) for name in names}
        return Columns(values, np.concatenate([np.arange(1, 1 + len(table[RUN])) for table in tables]), switches)

    def _one_run(self, run: str, pieces: Sequence[_Piece], names: Sequence[str]) -> dict[str, np.ndarray]:
        instants = np.unique(np.concatenate([piece.values[TIME] for piece in pieces]))
        found = {name: np.full(len(instants), np.nan) for name in names if name != RUN}
        found |= {TIME: instants, RUN: np.full(len(instants), run, dtype=object)}
        origin: dict[str, Path] = {}
        for piece in pieces:
            rows = np.searchsorted(instants, piece.values[TIME])
            for name in sorted(piece.values.keys() - {TIME}):
                if name in origin:
                    raise _twice(name, run, piece.path, origin[name])
                found[name][rows], origin[name] = piece.values[name], piece.path
        return found


@dataclass(frozen=True)
class _Piece:
    """The part of one run that one table has: column name -> values, time among them."""

    part: OnClock
    values: Mapping[str, np.ndarray]

    @property
    def path(self) -> Path:
        """The table's file."""
        return self.part.path

    @property
    def ends(self) -> tuple[float, float]:
        """First and last instant, as the table's clock has them [s]."""
        return _ends(self.values[TIME], self.part.origin or 0)


def _twice(column: str, run: str, path: Path, other: Path) -> BadInput:
    if path == other:
        return BadInput(f"run '{run}' is given twice", "name each table once", where=str(path))
    return BadInput(
        f"'{column}' of run '{run}' also stands in {other}",
        "tables that share a run are joined, and each column comes from one of them: take it out of the other, or give "
        "each run a name of its own",
        where=f"{path}, row 1, column '{column}'",
    )


def _ends(time: np.ndarray, origin: int) -> tuple[float, float]:
    return (float(time[0]) + origin, float(time[-1]) + origin) if len(time) else (np.nan, np.nan)


def _overlap(a: OnClock, b: OnClock) -> bool:
    (first, last), (begin, end) = a.span, b.span
    shorter = min(last - first, end - begin)
    return min(last, end) - max(first, begin) >= LEAST_OVERLAP * shorter > 0


def _check_overlap(run: str, pieces: Sequence[_Piece]) -> None:
    """Raise :class:`BadInput` where tables of one run are further apart than both of them last."""
    for one, other in combinations(pieces, 2):
        (first, last), (begin, end) = one.ends, other.ends
        if max(first, begin) - min(last, end) > (last - first) + (end - begin):
            raise apart(run, one.part, one.ends, other.part, other.ends)


def untied(tables: Sequence[TimedSource]) -> Untied | None:
    """What to say of tables that could be the topics of one recording, but for their clocks; None of others."""
    groups = [[*one.parts] if isinstance(one, JoinedSource) and one.run else [one] for one in tables]
    parts = [part for group in groups for part in group if isinstance(part, OnClock)]
    free = all(RUN not in part.names and not part.joined for part in parts)
    if len(groups) < 2 or len(parts) < sum(map(len, groups)) or not free:
        return None
    if not all(are_parts(a, b) for a, b in combinations(parts, 2)):
        return None
    one, other = parts[0], parts[len(groups[0])]
    return apart(name_of(parts), one, one.span, other, other.span)


def apart(run: str, one: OnClock, ends: tuple[float, float], other: OnClock, others: tuple[float, float]) -> Untied:
    """Two clocks that nothing ties: the ranges of both, and what to write.

    Args:
        run: that both tables hold.
        one, other: the tables.
        ends, others: their first and last instants [s].
    """
    offset = ends[0] - others[0] + other.column.offset
    return Untied(
        f"the clocks of run '{run}' do not overlap: '{one.clock}' goes from {ends[0]:.10g} to {ends[1]:.10g} s in "
        f"{one.path}, '{other.clock}' from {others[0]:.13g} to {others[1]:.13g} s in {other.path}",
        f'write what is to be added to one of them: [time."{_key(other.path, one.path)}"] offset_s = {offset:.6f}, '
        "where both began at the same instant",
        where=f"{one.path} + {other.path}",
    )


def _key(path: Path, other: Path) -> str:
    """As few of a path's last parts as tell it from another's."""
    parts, others = path.parts, other.parts
    few = next((n for n in range(1, len(parts)) if parts[-n:] != others[-n:]), len(parts))
    return "/".join(parts[-few:])


def _runs_of(source: OnClock) -> set[str]:
    """Names of the runs that a table holds."""
    if RUN not in source.names:
        return {source.path.stem}
    return set(map(str, source.columns([RUN], [RUN])[RUN].tolist()))
