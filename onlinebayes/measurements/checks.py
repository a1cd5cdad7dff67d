"""The rules that the columns of one run obey, whatever file or array they come from."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from onlinebayes.runs import BadInput


def check_columns(run: str, columns: Mapping[str, np.ndarray]) -> None:
    """Raise :class:`BadInput` unless the columns are one run: a time, equal lengths, values finite or nan.

    Args:
        run: its name, for the message.
        columns: column name -> values (T,); rows are counted from 1 in messages.
    """
    where = f"run '{run}'"
    if "time" not in columns:
        raise BadInput("no column 'time'", "give the instant of every row in seconds", where=where)
    time = columns["time"]
    for name, values in columns.items():
        if values.ndim != 1 or len(values) != len(time):
            raise BadInput(
                f"column '{name}' has shape {values.shape}, 'time' has {time.shape}",
                "give one value a row (nan where it was not measured)",
                where=where,
            )
        if (wrong := np.flatnonzero(np.isinf(values))).size:
            raise BadInput(
                f"{values[wrong[0]]} is not a number that can be measured",
                "use nan where it was not measured",
                where=f"{where}, row {wrong[0] + 1}, column '{name}'",
            )
        if name.startswith(("ctrl.", "enable.")) and (wrong := np.flatnonzero(np.isnan(values))).size:
            raise BadInput(
                "a command cannot be nan",
                "give the value that was sent",
                where=f"{where}, row {wrong[0] + 1}, column '{name}'",
            )
    if len(time) < 2:
        raise BadInput(f"{len(time)} row", "a run needs at least two rows", where=where)
    if (wrong := np.flatnonzero(np.isnan(time))).size:
        raise BadInput("time is nan", "every row has a time", where=f"{where}, row {wrong[0] + 1}")
    if (wrong := np.flatnonzero(np.diff(time) <= 0)).size:
        k = int(wrong[0])
        raise BadInput(
            f"time goes from {time[k]:.9g} to {time[k + 1]:.9g} s",
            "it must increase strictly within a run; sort the rows or start a new run",
            where=f"{where}, row {k + 2}",
        )
