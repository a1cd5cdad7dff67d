"""Rows of a result table as matrices: "pendulum: error" and "pendulum: time" share a line, with a column for each.

A name is parted at its last ": ", else at its last ", ". Cases that share columns form one matrix; where few rows are
left, so do the cases of one quantity. A cell that misses its goal is bold; the goal stands in the column's head where
all cells have it, else beside its value.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, final

MOST_COLUMNS, MOST_CELLS = 10, 80
MOST_LISTED = 40
"""Of so many rows that are left, those of one quantity become a matrix of one column."""
WIDE = 6
"""A matrix of more columns is turned, where it has fewer cases than columns."""
LEAST_CELLS, LEAST_FILLED = 6, 0.6
"""So many cells, and the share of them in which something has to stand."""
SHARE = re.compile(r"\d+ of \d+")
"""A unit that is the value in words."""

TableRow = Mapping[str, Any]
Column = tuple[str, str]
"""(quantity, unit)."""
Cells = Mapping[tuple[str, Column], TableRow]
"""(case, column) -> its row."""


@final
@dataclass(frozen=True)
class Matrix:
    """Rows by case and column."""

    cells: Cells

    @cached_property
    def cases(self) -> list[str]:
        """In the order of the rows."""
        return list(dict.fromkeys(case for case, _ in self.cells))

    @cached_property
    def columns(self) -> list[Column]:
        """In the order of the rows."""
        return list(dict.fromkeys(column for _, column in self.cells))

    @property
    def filled(self) -> float:
        """Share of the cells in which something stands."""
        return len(self.cells) / (len(self.cases) * len(self.columns))

    @property
    def fits(self) -> bool:
        """True if a page can show it."""
        few, many = sorted((len(self.cases), len(self.columns)))
        return few <= MOST_COLUMNS and LEAST_CELLS <= few * many <= MOST_CELLS

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Head and lines: cases below each other, or side by side where that is longer than wide."""
        shared = {column: self._goal(column) for column in self.columns}
        heads = [_head(column, goal) for column, goal in shared.items()]
        lines = [
            [_cell(self.cells.get((case, column)), goal) for column, goal in shared.items()] for case in self.cases
        ]
        if len(heads) <= max(WIDE, len(lines)) and len(heads) <= MOST_COLUMNS:
            return ["", *heads], [[case, *line] for case, line in zip(self.cases, lines, strict=True)]
        turned = zip(heads, zip(*lines, strict=True), strict=True)
        return ["", *self.cases], [[head, *line] for head, line in turned]

    def _goal(self, column: Column) -> str:
        goals = {row["goal"] or "" for (_, own), row in self.cells.items() if own == column}
        return goals.pop() if len(goals) == 1 else ""


def matrices(rows: Sequence[TableRow]) -> tuple[list[Matrix], list[TableRow]]:
    """Return what can be read as matrices, and the rows that are left."""
    found, left = list[Matrix](), list(rows)
    for mark in (": ", ", "):
        while more := [matrix for part in _parts(_parted(left, mark)) for matrix in _readable(part)]:
            found += more
            inside = {id(row) for matrix in more for row in matrix.cells.values()}
            left = [row for row in left if id(row) not in inside]
    if len(left) > MOST_LISTED:
        return found, left
    columns = dict[Column, dict[tuple[str, Column], TableRow]]()
    for key, row in _parted(left, ": ").items():
        columns.setdefault(key[1], {})[key] = row
    found += [Matrix(cells) for cells in columns.values() if len(cells) >= LEAST_CELLS]
    inside = {id(row) for matrix in found for row in matrix.cells.values()}
    return found, [row for row in left if id(row) not in inside]


def _parted(rows: Iterable[TableRow], mark: str) -> Cells:
    cells = dict[tuple[str, Column], TableRow]()
    for row in rows:
        case, found, quantity = row["name"].rpartition(mark)
        if found:
            cells.setdefault((case, (quantity, "" if SHARE.fullmatch(row["unit"]) else row["unit"])), row)
    return cells


def _parts(cells: Cells) -> Iterator[Cells]:
    """The cells of cases that share columns, each with some other one."""
    parts = list[set[Any]]()
    for case, column in cells:
        joined = [part for part in parts if case in part or column in part]
        parts = [part for part in parts if part not in joined] + [{case, column}.union(*joined)]
    for part in parts:
        yield {key: row for key, row in cells.items() if key[0] in part}


def _readable(cells: Cells) -> Iterator[Matrix]:
    """The matrix of these cells, without the columns that have the fewest of them, if there is one that can be read."""
    while cells := _shared(cells):
        matrix = Matrix(cells)
        if matrix.filled >= LEAST_FILLED:
            if matrix.fits:
                yield matrix
            return
        sizes = Counter(column for _, column in cells)
        sparsest = min(sizes, key=lambda column: sizes[column])
        cells = {key: row for key, row in cells.items() if key[1] != sparsest}


def _shared(cells: Cells) -> Cells:
    """What is left where each case has several columns and each column several cases."""
    while True:
        cases, columns = Counter(case for case, _ in cells), Counter(column for _, column in cells)
        kept = {key: row for key, row in cells.items() if cases[key[0]] > 1 and columns[key[1]] > 1}
        if len(kept) == len(cells):
            return cells
        cells = kept


def _head(column: Column, goal: str) -> str:
    quantity, unit = column
    return quantity + (f" [{unit}]" if unit else "") + (f", goal {goal}" if goal else "")


def _cell(row: TableRow | None, shared: str) -> str:
    if row is None:
        return ""
    text = row["value"] if isinstance(row["value"], str) else f"{row['value']:.4g}"
    text = row["unit"] if SHARE.fullmatch(row["unit"]) else text
    text = f"**{text}**" if row["holds"] is False else text
    return f"{text} ({row['goal']})" if row["goal"] and not shared else text
