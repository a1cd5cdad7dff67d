"""Assignment of rows to runs: those of one name, which stand together; without a ``run`` column all of them.

Where time begins again in a table without one, another column may name the runs.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from onlinebayes.measurements.formats import Columns, Source
from onlinebayes.runs import BadInput


def check_rises(time: Float[np.ndarray, " T"], clock: str, read: Columns, source: Source) -> None:
    """Raise :class:`BadInput` where time goes back in a table that is read as one run.

    Args:
        time: of every row [s].
        clock: the column that it comes from.
        read: the table's columns that were read.
        source: the table.
    """
    falls = np.flatnonzero(np.diff(time) < 0)
    if "run" in source.names or not falls.size:
        return
    k = int(falls[0])
    named = column_that_names_runs(source, clock, falls + 1)
    cure = f"'{named}' seems to name the runs" if named else "sort the rows, or, where a column names the runs"
    raise BadInput(
        f"time goes from {time[k]:.12g} to {time[k + 1]:.12g} s",
        f"it must increase strictly within a run: {cure}{':' if named else ','} call that column 'run'",
        where=f"{source.path}, row {read.rows[k + 1]}, column '{clock}'",
    )


def column_that_names_runs(source: Source, clock: str, starts: np.ndarray) -> str:
    """The first column with one text in each stretch of rising time, and another in each; empty where none is.

    Args:
        source: the table.
        clock: its column of time.
        starts: numbers of the rows with which all stretches but the first begin.
    """
    for name in source.names:
        if name == clock:
            continue
        try:
            texts = source.columns([name], [name])[name]
        except BadInput:  # not of texts
            continue
        said = [set(stretch.tolist()) for stretch in np.split(texts, starts)]
        names = set().union(*said)
        if "" not in names and len(names) == len(said) and all(len(one) == 1 for one in said):
            return name
    return ""


def run_rows(read: Columns, path: Path) -> dict[str, slice]:
    """Run name -> its rows; the file's stem where there is no run column."""
    if "run" not in read:
        return {path.stem: slice(0, len(read.rows))}
    names = read["run"]
    if (empty := np.flatnonzero(names == "")).size:
        raise BadInput("a row without a run", "name its run", where=f"{path}, row {read.rows[empty[0]]}, column 'run'")
    starts = np.concatenate([[0], np.flatnonzero(names[1:] != names[:-1]) + 1])
    ends = np.concatenate([starts[1:], [len(names)]])
    found: dict[str, slice] = {}
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        if not (run := str(names[start])).isprintable():
            raise BadInput(
                f"run {run[:40]!r} has characters that cannot be shown",
                "name runs by letters and digits",
                where=f"{path}, row {read.rows[start]}, column 'run'",
            )
        if run in found:
            raise BadInput(
                f"run '{run}' begins again (it ended at row {read.rows[found[run].stop - 1]})",
                "put the rows of a run together, or give the second part a name of its own",
                where=f"{path}, row {read.rows[start]}, column 'run'",
            )
        found[run] = slice(start, end)
    return found
