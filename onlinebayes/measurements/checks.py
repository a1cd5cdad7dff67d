"""The rules that the columns of one run obey, whatever file or array they come from."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Int

from onlinebayes.runs import BadInput

LARGEST = 1e12
"""Beyond this no quantity in SI units was measured: a wrong unit, or a sensor's code for "no value"."""


def check_columns(
    columns: Mapping[str, np.ndarray], where: str, rows: Int[np.ndarray, " T"] | None = None, clock: str = "time"
) -> None:
    """Raise :class:`BadInput` unless the columns are one run: a time that increases, equal lengths, finite or nan.

    Args:
        columns: column name -> values (T,).
        where: what holds them, for the message, e.g. ``"run 'a'"``.
        rows: number of each row in messages; counted from 1 by default.
        clock: what messages call the column of time.
    """
    if "time" not in columns:
        raise BadInput("no column 'time'", "give the instant of every row in seconds", where=where)
    time = columns["time"]
    for name, values in columns.items():
        if values.ndim != 1 or values.shape != time.shape:
            raise BadInput(
                f"column '{name}' has shape {values.shape}, 'time' has {time.shape}",
                "give one value a row (nan where it was not measured)",
                where=where,
            )
    rows = np.arange(1, len(time) + 1) if rows is None else rows
    for name, values in columns.items():
        _check_values(name, values, f"column '{clock if name == 'time' else name}'", where, rows)
    if len(time) < 2:
        at = f", row {rows[0]}" if len(time) else ""
        raise BadInput(f"a run of {len(time)} row{'' if len(time) == 1 else 's'}", "give two or more", where=where + at)
    _check_increases(time, where, rows, clock)


def check_time(time: np.ndarray, where: str, rows: Int[np.ndarray, " T"], clock: str = "time") -> None:
    """Raise :class:`BadInput` unless the instants are known and increase; arguments as :func:`check_columns`."""
    _check_values("time", time, f"column '{clock}'", where, rows)
    _check_increases(time, where, rows, clock)


def check_instants(time: np.ndarray, where: str, rows: Int[np.ndarray, " T"], clock: str = "time") -> None:
    """Raise :class:`BadInput` unless the instants are known and of a size that a clock in seconds has."""
    _check_values("time", time, f"column '{clock}'", where, rows)


def _check_increases(time: np.ndarray, where: str, rows: np.ndarray, clock: str) -> None:
    if (wrong := np.flatnonzero(np.diff(time) <= 0)).size:
        k = int(wrong[0])
        raise BadInput(
            f"time goes from {time[k]:.12g} to {time[k + 1]:.12g} s",
            "it must increase strictly within a run: sort the rows, drop repeated ones, or start a new run",
            where=f"{where}, row {rows[k + 1]}, column '{clock}'",
        )


def _check_values(name: str, values: np.ndarray, column: str, where: str, rows: np.ndarray) -> None:
    if (wrong := np.flatnonzero(np.isinf(values))).size:
        raise BadInput(
            f"{values[wrong[0]]} is no measured value",
            "leave the cell empty (or nan) where nothing was measured",
            where=f"{where}, row {rows[wrong[0]]}, {column}",
        )
    if (wrong := np.flatnonzero(np.abs(values) > LARGEST)).size:
        raise BadInput(
            f"{values[wrong[0]]:g} is too large for a measured value",
            'give its unit: [time] unit = "ns" (or "us", "ms") in the problem file'
            if name == "time"
            else "use SI units, and leave the cell empty (or nan) where nothing was measured",
            where=f"{where}, row {rows[wrong[0]]}, {column}",
        )
    needed = name == "time" or name.startswith(("ctrl.", "enable."))
    if needed and (wrong := np.flatnonzero(np.isnan(values))).size:
        raise BadInput(
            f"{'the time' if name == 'time' else 'a command'} cannot be nan",
            "give the instant of the row in seconds" if name == "time" else "give the value that was sent",
            where=f"{where}, row {rows[wrong[0]]}, {column}",
        )
