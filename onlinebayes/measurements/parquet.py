"""The columns of a Parquet file; pyarrow is imported only when one is read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from onlinebayes.runs import BadInput


def parquet_header(path: Path) -> list[str]:
    """The column names of a Parquet file; raises :class:`BadInput` when it is damaged or pyarrow is missing."""
    return [name.strip() for name in _open(path).schema_arrow.names]


def parquet_columns(
    path: Path, names: Sequence[str], text: Sequence[str], held: Sequence[str]
) -> dict[str, np.ndarray]:
    """Some columns as float64 (nan where null), those of ``text`` as strings; see ``files.columns``."""
    import pyarrow as pa

    file = _open(path)
    stored = {name.strip(): name for name in file.schema_arrow.names}
    try:
        table = file.read([stored[name] for name in names])
    except (pa.ArrowInvalid, OSError) as error:
        raise BadInput(f"is a damaged Parquet file: {error}", "write it again", where=str(path)) from None
    if table.num_rows == 0:
        raise BadInput("the table has no rows", "give at least two rows a run", where=str(path))
    read: dict[str, np.ndarray] = {}
    for name in names:
        column = table.column(stored[name])
        if name in text:
            read[name] = np.array(["" if v is None else str(v).strip() for v in column.to_pylist()], dtype=object)
        else:
            read[name] = _numbers(column, name, path, name in held)
    return read


def _open(path: Path) -> Any:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise BadInput(
            "reading Parquet needs pyarrow",
            "pip install 'onlinebayes[parquet]', or save the table as CSV",
            where=str(path),
        ) from None
    try:
        return pq.ParquetFile(path)
    except (pa.ArrowInvalid, OSError) as error:
        raise BadInput(f"is a damaged Parquet file: {error}", "write it again", where=str(path)) from None


def _numbers(column: Any, name: str, path: Path, held: bool) -> np.ndarray:
    import pyarrow as pa
    import pyarrow.compute as pc

    kind = column.type
    if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind)):
        raise BadInput(
            f"the column holds {kind}, not numbers",
            "write time in seconds and values in SI units as float64",
            where=f"{path}, column '{name}'",
        )
    if pa.types.is_boolean(kind):
        column = column.cast(pa.int8())
    column = column.cast(pa.float64())
    if held:
        written = pc.and_(pc.is_valid(column), pc.is_nan(column)).fill_null(False).to_numpy()
        if written.any():
            raise BadInput(
                "a command cannot be nan",
                "give the value that was sent, or null to hold the last one",
                where=f"{path}, row {int(np.flatnonzero(written)[0]) + 2}, column '{name}'",
            )
    return column.to_numpy()
