"""The columns of a Parquet file; pyarrow is imported only when one is read.

Rows are counted as a spreadsheet would show them, the header being row 1. Source of the format:
https://parquet.apache.org/docs/file-format.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from onlinebayes.measurements.formats.source import Columns, Source, check_cells
from onlinebayes.runs import BadInput


class ParquetSource(Source):
    """A Parquet file of flat columns; reading it needs the extra ``parquet``.

    Args:
        path: the file.

    Raises:
        BadInput: it is damaged, two columns share a name, or pyarrow is missing.
    """

    def __init__(self, path: Path) -> None:
        file = open_parquet(path)
        super().__init__(path, [name.strip() for name in file.schema_arrow.names])
        self._stored = dict(zip(self.names, file.schema_arrow.names, strict=True))
        self._kinds = dict(zip(self.names, file.schema_arrow.types, strict=True))

    def columns(
        self, names: Sequence[str], text: Sequence[str] = (), held: Sequence[str] = (), exact: Sequence[str] = ()
    ) -> Columns:
        """See :meth:`Source.columns`; a null is an empty cell."""
        for name in names:
            if name in text and "list" in str(self._kinds[name]):
                cure = "write one name a row"
                raise BadInput(f"column '{name}' holds lists, not texts", cure, where=str(self.path))
            if name not in text:
                _check_numbers(self._kinds[name], name, self.path)
        table = read_parquet(self.path, [self._stored[name] for name in names], [self._stored[name] for name in text])
        if table.num_rows == 0:
            raise BadInput("the table has no rows", "give at least two rows a run", where=str(self.path))
        read: dict[str, np.ndarray] = {}
        for name in names:
            column = table.column(self._stored[name])
            if name in text:
                read[name] = _texts(column, name, self.path)
            elif name in exact and (whole := _whole(column)) is not None:
                read[name] = whole
            else:
                read[name] = _numbers(column, name, self.path, name in held)
        switches = [name for name in names if name in held and str(self._kinds[name]) == "bool"]
        return Columns(read, np.arange(2, 2 + table.num_rows), switches)


def read_parquet(path: Path, names: Sequence[str], text: Sequence[str] = ()) -> Any:
    """Some columns as a pyarrow table, those of ``text`` as dictionaries.

    Raises:
        BadInput: the file is damaged or far too large.
    """
    file = open_parquet(path, text)
    try:
        groups = [file.metadata.row_group(k) for k in range(file.metadata.num_row_groups)]
        leaves = [group.column(j) for group in groups for j in range(group.num_columns)]
        # A list column has more values than rows; its leaf is called "NAME.list.element".
        cells = sum(leaf.num_values for leaf in leaves if leaf.path_in_schema.startswith(tuple(names)))
        check_cells(max(cells, file.metadata.num_rows), 1, path)
        return file.read(list(names))
    except BadInput:
        raise
    except Exception as error:  # what damaged bytes raise inside pyarrow is not documented
        raise _damaged(error, path) from None


def open_parquet(path: Path, text: Sequence[str] = ()) -> Any:
    """The file's schema and sizes; raises :class:`BadInput` when it is damaged or pyarrow is missing."""
    try:
        import pyarrow.parquet as pq
    except ImportError:
        raise BadInput(
            "reading Parquet needs pyarrow",
            "install the extra parquet (pip install -e '.[parquet]' in the repository), or save the table as CSV",
            where=str(path),
        ) from None
    try:
        return pq.ParquetFile(path, read_dictionary=list(text))
    except Exception as error:  # what damaged bytes raise inside pyarrow is not documented
        raise _damaged(error, path) from None


def _damaged(error: Exception, path: Path) -> BadInput:
    return BadInput(f"is a damaged Parquet file: {str(error)[:200]}", "write it again", where=str(path))


def _texts(column: Any, name: str, path: Path) -> np.ndarray:
    """Each distinct text once in memory, however many rows say it."""
    import pyarrow as pa

    parts = [np.empty(0, dtype=object)]
    for chunk in column.chunks:
        try:
            coded = chunk if pa.types.is_dictionary(chunk.type) else chunk.dictionary_encode()
            texts = [str(text).strip() for text in coded.dictionary.cast(pa.string()).to_pylist()]
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            problem = f"the column holds {column.type}, not texts"
            raise BadInput(problem, "write names of runs", where=f"{path}, column '{name}'") from None
        places = coded.indices.fill_null(len(texts)).to_numpy(zero_copy_only=False)
        parts.append(np.array([*texts, ""], dtype=object)[places])
    return np.concatenate(parts)


def is_numeric(kind: Any) -> bool:
    """Check whether a column of this type casts to float64; one of nulls alone has a type of its own."""
    import pyarrow as pa

    types = pa.types
    numbers = types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind)
    return bool(numbers or types.is_boolean(kind) or types.is_null(kind))


def _check_numbers(kind: Any, name: str, path: Path) -> None:
    if not is_numeric(kind):
        raise BadInput(
            f"the column holds {kind}, not numbers",
            "write time in seconds and values in SI units as float64",
            where=f"{path}, column '{name}'",
        )


def _whole(column: Any) -> np.ndarray | None:
    """The column as int64; None where it holds nulls, fractions or more bits."""
    import pyarrow as pa

    if not pa.types.is_integer(column.type) or column.null_count:
        return None
    try:
        return column.cast(pa.int64()).to_numpy()
    except pa.ArrowInvalid:
        return None


def _numbers(column: Any, name: str, path: Path, held: bool) -> np.ndarray:
    import pyarrow as pa
    import pyarrow.compute as pc

    kind = column.type
    if pa.types.is_boolean(kind):
        column = column.cast(pa.int8())
    column = column.cast(pa.float64(), safe=False)
    if held:
        written = pc.and_(pc.is_valid(column), pc.is_nan(column)).fill_null(False).to_numpy()
        if written.any():
            raise BadInput(
                "a command cannot be nan",
                "give the value that was sent, or null to hold the last one",
                where=f"{path}, row {int(np.flatnonzero(written)[0]) + 2}, column '{name}'",
            )
    return column.to_numpy()
