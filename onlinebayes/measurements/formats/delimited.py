"""The columns of a CSV file, read in pieces; every error names the file, the row and the column.

Rows are counted as a spreadsheet shows them: the header is row 1, empty lines count. CSV is UTF-8 (a byte-order mark
is fine), comma separated, with a decimal point.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from onlinebayes.measurements.formats.source import Columns, Source
from onlinebayes.runs import BadInput

CHUNK = 100_000
"""Rows that are held as text at once."""

CHUNK_CELLS = 5_000_000
"""Cells that are held as text at once, where the rows are wide."""

LONGEST_LINE = 4_000_000
"""Characters in one line; what is longer is no table, and would be held in memory as a whole."""

SWITCHED = {"true": "1", "false": "0"}
FEW = 100
"""Rows in which a column of truth values shows one."""
NUMBER_WITH_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")


class CsvSource(Source):
    """A CSV file; its column names are stripped of surrounding blanks.

    Args:
        path: the file.

    Raises:
        BadInput: the file is unreadable, no table, empty, not UTF-8, not separated by commas, or two columns share a
            name.
    """

    def __init__(self, path: Path) -> None:
        with csv_rows(path) as rows:
            first = next(rows, None)
        if not first:
            raise BadInput("the first row is empty", "begin with a row of column names", where=str(path))
        names = [name.strip() for name in first]
        _check_separator(names, path)
        super().__init__(path, names)

    def columns(
        self, names: Sequence[str], text: Sequence[str] = (), held: Sequence[str] = (), exact: Sequence[str] = ()
    ) -> Columns:
        """See :meth:`Source.columns`."""
        parts: dict[str, list[np.ndarray]] = {name: [] for name in names}
        numbers: list[np.ndarray] = []
        places = {name: self.names.index(name) for name in names}
        switches: set[str] = set()
        with csv_rows(self.path) as rows:
            next(rows)
            for chunk, at in _chunks(rows, len(self.names), self.path):
                numbers.append(at)
                cells = list(zip(*chunk, strict=True))
                for name, place in places.items():
                    if name in text:
                        parts[name].append(np.array([cell.strip() for cell in cells[place]], dtype=object))
                    elif name in exact and (whole := _whole(cells[place])) is not None:
                        parts[name].append(whole)
                    else:
                        parts[name].append(_numbers(cells[place], name, self.path, at, name in held))
                        if name in held and any(cell.strip().lower() in SWITCHED for cell in cells[place][:FEW]):
                            switches.add(name)
        if not numbers:
            raise BadInput("a header and no rows", "give at least two rows a run", where=str(self.path))
        values = {name: np.concatenate(part) for name, part in parts.items()}
        return Columns(values, np.concatenate(numbers), switches)


@contextmanager
def csv_rows(path: Path) -> Iterator[Iterator[list[str]]]:
    """The rows of a CSV file as lists of cells; what the reader finds wrong becomes :class:`BadInput`."""
    reader = None
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(_lines(file, path), strict=True)
            yield reader
    except UnicodeDecodeError:
        cure = "save it as UTF-8, or give it the ending of its own format (.parquet, .mcap, .rrd)"
        raise BadInput("the file is not UTF-8", cure, where=f"{path}, {_undecodable(path)}") from None
    except csv.Error as error:
        line = f", line {reader.line_num}" if reader else ""
        raise BadInput(f"is no readable CSV: {error}", "check the quotes on that line", where=f"{path}{line}") from None


def _lines(file: TextIO, path: Path) -> Iterator[str]:
    while line := file.readline(LONGEST_LINE):
        if len(line) == LONGEST_LINE:
            raise BadInput(
                f"a line of more than {LONGEST_LINE} characters",
                "write one row a line, cells separated by commas",
                where=str(path),
            )
        yield line


def _undecodable(path: Path) -> str:
    number = 0
    with path.open("rb") as file:
        for number, line in enumerate(iter(lambda: file.readline(4 * LONGEST_LINE), b""), start=1):
            try:
                line.decode("utf-8")
            except UnicodeDecodeError as error:
                return f"row {number}, byte 0x{line[error.start]:02x}"
    return f"row {number}"


def _check_separator(names: Sequence[str], path: Path) -> None:
    if any("\0" in name for name in names):
        raise BadInput("is not a text file", "name a CSV or Parquet file", where=str(path))
    joined = ",".join(names)
    for mark, called in ((";", "semicolons"), ("\t", "tabs"), ("|", "bars")):
        if joined.count(mark) > joined.count(","):
            raise BadInput(
                f"the columns are separated by {called}",
                "save the table with commas between columns and a point in the numbers",
                where=f"{path}, row 1",
            )


def _chunks(rows: Iterator[list[str]], width: int, path: Path) -> Iterator[tuple[list[list[str]], np.ndarray]]:
    """Pieces of rows that are not empty, each with the rows' numbers."""
    start = 2
    most = max(1, min(CHUNK, CHUNK_CELLS // width))
    while chunk := list(islice(rows, most)):
        at = np.arange(start, start + len(chunk))
        start += len(chunk)
        lengths = np.fromiter(map(len, chunk), dtype=np.int64, count=len(chunk))
        if (wrong := np.flatnonzero((lengths != width) & (lengths != 0))).size:
            k = int(wrong[0])
            raise BadInput(
                f"{lengths[k]} cells where the header has {width}",
                "give every row one cell a column; leave a cell empty where nothing was measured",
                where=f"{path}, row {at[k]}",
            )
        if not lengths.all():
            chunk, at = [row for row in chunk if row], at[lengths > 0]
        if chunk:
            yield chunk, at


def _whole(cells: Sequence[str]) -> np.ndarray | None:
    """The cells as int64; None where one is no whole number, or has more bits."""
    try:
        return np.array([int(cell) for cell in cells], dtype=np.int64)
    except (ValueError, OverflowError):
        return None


def _numbers(cells: Sequence[str], name: str, path: Path, rows: np.ndarray, held: bool) -> np.ndarray:
    try:
        values = np.array([float(cell) if cell else np.nan for cell in cells])
    except ValueError:
        cells = [cell.strip() for cell in cells]
        if held:  # a switch may be written as a truth value
            cells = [SWITCHED.get(cell.lower(), cell) for cell in cells]
        for cell, row in zip(cells, rows, strict=True):
            _check_number(cell, name, path, int(row))
        values = np.array([float(cell) if cell else np.nan for cell in cells])
    if held and np.isnan(values).sum() != sum(1 for cell in cells if not cell.strip()):
        wrong = next(k for k, cell in enumerate(cells) if cell.strip() and np.isnan(values[k]))
        raise BadInput(
            "a command cannot be nan",
            "give the value that was sent, or leave the cell empty to hold the last one",
            where=f"{path}, row {rows[wrong]}, column '{name}'",
        )
    return values


def _check_number(cell: str, name: str, path: Path, row: int) -> None:
    try:
        float(cell or "nan")
    except ValueError:
        shown = cell if len(cell) <= 40 else cell[:37] + "..."
        cure = "write seconds" if name == "time" else "leave the cell empty where nothing was measured"
        if NUMBER_WITH_COMMA.fullmatch(cell):
            cure = "write numbers with a decimal point"
        raise BadInput(f"'{shown}' is not a number", cure, where=f"{path}, row {row}, column '{name}'") from None
