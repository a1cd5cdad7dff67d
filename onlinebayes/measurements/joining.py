"""Tables that hold the same runs, each with some of their columns -> one table.

    rows of a run t_0 < t_1 < ... = all its instants in the tables that hold it
    cell (i, c) = what the table with column c has at t_i, empty where it has no row then

Nothing is interpolated: signals have cells that were not measured, commands hold their last value, as in any table.
Tables that share a run share its clock. A log that counts time from its own first sample shares it with none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from onlinebayes.measurements.checks import check_time
from onlinebayes.measurements.formats import Columns, Source
from onlinebayes.measurements.mapping import TimeColumn
from onlinebayes.measurements.stretches import check_rises, run_rows
from onlinebayes.runs import BadInput

RUN = "run"


def joined(sources: Sequence[Source], clock: TimeColumn) -> list[Source]:
    """The tables, each group that shares runs as one; those of the same columns stand alone, whatever runs they hold.

    Args:
        sources: each with a column of time.
        clock: that column.

    Raises:
        BadInput: a table's runs cannot be read, or share no clock with another table's.
    """
    if len({frozenset(source.names) for source in sources}) < 2:
        return list(sources)
    groups: list[tuple[list[Source], set[str]]] = []
    for source in sources:
        own = _runs_of(source)
        others = [group for group in groups if group[1] & own]
        groups = [group for group in groups if group not in others]
        members = [*(member for group in others for member in group[0]), source]
        groups.append((members, own.union(*(runs for _, runs in others))))
    return [group[0] if len(group) == 1 else JoinedSource(group, clock) for group, _ in groups]


class JoinedSource(Source):
    """Several tables as one; see the module's equation. Rows are counted from 1 in each run.

    Args:
        parts: two tables or more.
        clock: their column of time.

    Raises:
        BadInput: a table that counts time from its own first sample.
    """

    def __init__(self, parts: Sequence[Source], clock: TimeColumn) -> None:
        if alone := [part for part in parts if part.joined]:
            others = ", ".join(str(part.path) for part in parts if part is not alone[0])
            raise BadInput(
                f"holds a run of {others}, but counts time from its own first sample: nothing ties the two clocks",
                "record both into one log, convert it to a table with the clock of the other, or rename the run",
                where=str(alone[0].path),
            )
        names = dict.fromkeys([RUN, *(name for part in parts for name in part.names)])
        # On clocks of their own: a run may begin before its first command was sent.
        super().__init__(Path(" + ".join(str(part.path) for part in parts)), tuple(names), joined=True)
        self.parts, self.clock = tuple(parts), clock

    def columns(self, names: Sequence[str], text: Sequence[str] = (), held: Sequence[str] = ()) -> Columns:
        """See :meth:`Source.columns`.

        Raises:
            BadInput: of the tables themselves, or a column that two tables have of one run.
        """
        runs: dict[str, list[_Piece]] = {}
        for part in self.parts:
            own = {*names, RUN, self.clock.column} & {*part.names}
            read = part.columns(sorted(own), sorted({*text, RUN} & own), sorted({*held} & own))
            check_rises(read[self.clock.column] * self.clock.scale, self.clock.column, read, part)
            for run, rows in run_rows(read, part.path).items():
                piece = {name: read[name][rows] for name in own if name != RUN}
                check_time(piece[self.clock.column], str(part.path), read.rows[rows], self.clock.column)
                runs.setdefault(run, []).append(_Piece(part.path, piece))
        tables = [self._one_run(run, pieces, names) for run, pieces in runs.items()]
        values = {name: np.concatenate([table[name] for table in tables]) for name in names}
        return Columns(values, np.concatenate([np.arange(1, 1 + len(table[RUN])) for table in tables]))

    def _one_run(self, run: str, pieces: Sequence[_Piece], names: Sequence[str]) -> dict[str, np.ndarray]:
        clock = self.clock.column
        instants = np.unique(np.concatenate([piece.values[clock] for piece in pieces]))
        found = {name: np.full(len(instants), np.nan) for name in names if name != RUN}
        found |= {clock: instants, RUN: np.full(len(instants), run, dtype=object)}
        origin: dict[str, Path] = {}
        for piece in pieces:
            rows = np.searchsorted(instants, piece.values[clock])
            for name in sorted(piece.values.keys() - {clock}):
                if name in origin:
                    raise _twice(name, run, piece.path, origin[name])
                found[name][rows], origin[name] = piece.values[name], piece.path
        return found


@dataclass(frozen=True)
class _Piece:
    """The part of one run that one table has: column name -> values, time among them."""

    path: Path
    values: Mapping[str, np.ndarray]


def _twice(column: str, run: str, path: Path, other: Path) -> BadInput:
    if path == other:
        return BadInput(f"run '{run}' is given twice", "name each table once", where=str(path))
    return BadInput(
        f"'{column}' of run '{run}' also stands in {other}",
        "tables that share a run are joined, and each column comes from one of them: take it out of the other, or give "
        "each run a name of its own",
        where=f"{path}, row 1, column '{column}'",
    )


def _runs_of(source: Source) -> set[str]:
    """Names of the runs that a table holds."""
    if RUN not in source.names:
        return {source.path.stem}
    return set(map(str, source.columns([RUN], [RUN])[RUN].tolist()))
