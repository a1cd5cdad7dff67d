"""The Markdown page of a result table, made from its JSON.

Rows of which many share cases and quantities are a matrix (:mod:`.results_matrix`). Others are listed, or, where they
are many, summed up: the missed goals; for each quantity that several rows have, the least, the median and the largest
value; and the first of the other rows. A row's quantity is what its name says behind the last ": ", whatever numbers it
has.
"""

from __future__ import annotations

import re
import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from onlinebayes.runs.results_matrix import SHARE, matrices

ROWS = 24
"""More rows than that, beside the matrices, are summed up."""
LINES = 8
"""Quantities and other rows of a summary are at most so many each."""
SEVERAL = 3
"""So many rows of one quantity become one line."""
CHARACTERS = 60
"""A longer text is cut in a summary."""
OLDER = "Printed by older code, before tables named their commit: the code of today may print other figures."
HOLDS = {None: "", True: "yes", False: "**no**"}
NUMBERS = re.compile(r"\d[\d.,]*")

TableRow = Mapping[str, Any]
Cells = Sequence[str]


def result_page(table: Mapping[str, Any]) -> str:
    """The page of a table.

    Args:
        table: what its JSON holds.
    """
    rows, file = table["rows"], f"{table['name']}.json"
    judged = [row for row in rows if row["holds"] is not None]
    held = f"{sum(row['holds'] for row in judged)} of {len(judged)} goals are held. " if judged else ""
    spreads = " and their spreads" if any(row["spread"] is not None for row in rows) else ""
    found, left = matrices(rows)
    bold = any(row["holds"] is False for matrix in found for row in matrix.cells.values())
    lines = [*_head(table), f"{held}All {len(rows)} rows{spreads}: [{file}]({file})."]
    lines[-1] += " Bold: the goal is missed." if bold else ""
    for matrix in found:
        lines += ["", *_lines(*matrix.table())]
    if left:
        lines += ["", *_full(left)] if len(left) <= ROWS else _summary(left)
    return "\n".join(lines) + "\n"


def full_table(table: Mapping[str, Any]) -> str:
    """The head of a table and every row, for the terminal."""
    return "\n".join([*_head(table), *_full(table["rows"])]) + "\n"


def _full(rows: Sequence[TableRow], limit: int | None = None) -> list[str]:
    """Every row of a table, or the first ones; columns in which nothing stands are left out."""
    cells = [
        (row["name"], _text(row["value"]), _text(row["spread"]), row["unit"], row["goal"] or "", HOLDS[row["holds"]])
        for row in rows
    ]
    return _lines(("name", "value", "spread", "unit", "goal", "holds"), cells, limit)


def _head(table: Mapping[str, Any]) -> list[str]:
    seeds, date = ", ".join(map(str, table["seeds"])), table.get("date")
    when = f" on {date}" if date else ""
    code = f"commit {table.get('commit') or 'unknown'}; " if date else ""
    line = f"Printed by `{table['command']}`{when} ({code}seeds {seeds or 'none'}; {table['machine']})."
    return [f"# {table['name']}", "", line, *([] if date else [OLDER]), ""]


def _summary(rows: Sequence[TableRow]) -> list[str]:
    missed = [row for row in rows if row["holds"] is False]
    groups = [group for group in by_quantity(rows).values() if len(group) >= SEVERAL]
    groups.sort(key=lambda group: all(row["holds"] is None for row in group))
    told = {id(row) for row in [*missed, *(row for group in groups for row in group)]}
    others = sorted((row for row in rows if id(row) not in told), key=lambda row: row["holds"] is None)
    lines = []
    if missed:
        lines += ["", "## Missed", *_full([{**_short(row), "holds": None} for row in missed])]
    if groups:
        columns = ("quantity", "rows", "least", "median", "largest", "unit", "goals held")
        lines += ["", "## By quantity", *_lines(columns, [_cells(group) for group in groups], LINES)]
    if others:
        lines += ["", "## Other rows", *_full([_short(row) for row in others], LINES)]
    return lines


def _short(row: TableRow) -> dict[str, Any]:
    """A row without its spread, its texts cut."""
    cut = {key: f"{text[:CHARACTERS]}..." for key in ("value", "unit") if len(text := str(row[key])) > CHARACTERS}
    return {**row, **cut, "spread": None}


def by_quantity(rows: Sequence[TableRow]) -> dict[tuple[str, str], list[TableRow]]:
    """(quantity, unit) -> its rows; texts are left out."""
    groups = dict[tuple[str, str], list[TableRow]]()
    for row in rows:
        if not isinstance(row["value"], str):
            unit = "share" if SHARE.fullmatch(row["unit"]) else row["unit"]
            groups.setdefault((NUMBERS.sub("...", row["name"].rpartition(": ")[2]), unit), []).append(row)
    return groups


def _cells(rows: list[TableRow]) -> Cells:
    """One line for rows of one quantity."""
    values, holds = [row["value"] for row in rows], [row["holds"] for row in rows if row["holds"] is not None]
    names, units = {row["name"].rpartition(": ")[2] for row in rows}, {row["unit"] for row in rows}
    name = names.pop() if len(names) == 1 else NUMBERS.sub("...", names.pop())
    numbers = [_text(of(values)) for of in (min, statistics.median, max)]
    held = f"{sum(holds)} of {len(holds)}" if holds else ""
    return name, str(len(rows)), *numbers, units.pop() if len(units) == 1 else "", held


def _lines(columns: Cells, rows: Sequence[Cells], limit: int | None = None) -> list[str]:
    """A Markdown table of the columns in which something stands; of more rows than the limit, the first ones."""
    shown = [i for i in range(len(columns)) if i == 0 or any(row[i] for row in rows)]
    lines = [[columns[i] for i in shown], *([row[i].replace("|", "\\|") for i in shown] for row in rows[:limit])]
    head, *body = ("| " + " | ".join(line) + " |" for line in lines)
    more = ["", f"And {len(rows) - limit} more."] if limit and len(rows) > limit else []
    return [head, "|" + "---|" * len(shown), *body, *more]


def _text(value: float | str | None) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else f"{value:.4g}"
