"""The interface of a file of measurements, whatever its format: names of columns, and the columns as arrays.

Units, signs, ``ignore`` and the rules of a run stand above this, in ``measurements/tables.py``; a format only turns
bytes into columns. A file may be hostile: nothing is read that would need more than ``MOST_CELLS`` numbers.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np

from onlinebayes.runs import BadInput

MOST_COLUMNS = 10_000
MOST_CELLS = 100_000_000
"""800 MB of float64: ten signals at 1 kHz for nearly three hours."""


class Columns(dict[str, np.ndarray]):
    """Column name -> values, with the number of each row in its file.

    Attributes:
        rows: (T,) numbers of the rows.
        switches: names of number columns that were written as truth values.
    """

    def __init__(self, values: dict[str, np.ndarray], rows: np.ndarray, switches: Collection[str] = ()) -> None:
        super().__init__(values)
        self.rows, self.switches = rows, frozenset(switches)


class Source(ABC):
    """One file (or folder) of measurements.

    Args:
        path: where it lies.
        names: its columns, in its order; ``time`` [s] and perhaps ``run`` are among them.
        joined: whether its signals were logged on clocks of their own, so that a run may begin before its first
            command was sent.

    Raises:
        BadInput: two columns share a name, or there are more than ``MOST_COLUMNS``.
    """

    def __init__(self, path: Path, names: Sequence[str], *, joined: bool = False) -> None:
        self.path, self.names, self.joined = path, tuple(names), joined
        if len(self.names) > MOST_COLUMNS:
            raise BadInput(
                f"{len(self.names)} columns; at most {MOST_COLUMNS} can be read",
                "write only what was measured",
                where=str(path),
            )
        counts = Counter(self.names)
        for name in self.names:
            if name and counts[name] > 1:
                raise BadInput(
                    f"two columns are called '{name[:80]}'",
                    "give each column a name of its own",
                    where=f"{path}, row 1",
                )

    @abstractmethod
    def columns(
        self, names: Sequence[str], text: Sequence[str] = (), held: Sequence[str] = (), exact: Sequence[str] = ()
    ) -> Columns:
        """Some columns.

        Args:
            names: which, all of them among ``self.names``.
            text: those that stay text; the others are numbers, nan where there is no value.
            held: number columns in which a written nan is an error, for their missing values mean the last one.
            exact: number columns that stay int64 where all their cells are whole numbers, beyond 53 bits, too.

        Raises:
            BadInput: what cannot be read, with row and column.
        """


class ArraySource(Source):
    """Columns that are in memory already, rows counted from 1.

    Args:
        path: where they came from.
        values: column name -> (T,) numbers, or texts under ``run``.
        joined: see :class:`Source`.
    """

    def __init__(self, path: Path, values: Mapping[str, np.ndarray], *, joined: bool = False) -> None:
        super().__init__(path, tuple(values), joined=joined)
        self._values = values

    def columns(
        self, names: Sequence[str], text: Sequence[str] = (), held: Sequence[str] = (), exact: Sequence[str] = ()
    ) -> Columns:
        """See :meth:`Source.columns`."""
        for name in held:
            check_held(self._values[name], f"{self.path}, '{name}'")
        count = len(self._values[names[0]])
        return Columns({name: self._values[name] for name in names}, np.arange(1, count + 1))


def check_held(samples: np.ndarray, where: str) -> None:
    """Raise :class:`BadInput` when a command was logged as nan: nothing says what the actuator then did."""
    if (wrong := np.flatnonzero(np.isnan(samples))).size:
        raise BadInput(
            f"a command cannot be nan (sample {wrong[0] + 1})", "log the value that was sent, or nothing", where=where
        )


def check_cells(rows: int, columns: int, path: Path) -> None:
    """Raise :class:`BadInput` when a table of this size would not fit into memory."""
    if rows * max(columns, 1) > MOST_CELLS:
        raise BadInput(
            f"{rows * max(columns, 1)} numbers; at most {MOST_CELLS} can be read at once",
            "cut the log into several files",
            where=str(path),
        )
