"""The split into runs that are fitted and runs that are opened at the end."""

from __future__ import annotations

from collections.abc import Sequence

from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput

LAST_THIRD = " (last third)"
HALVES = (" (first half)", " (second half)")


def origin(part: str) -> str:
    """The run that a part was cut from; a whole run's own name."""
    for suffix in (*HALVES, LAST_THIRD):
        part = part.removesuffix(suffix)
    return part


def split(measurement: Measurement, holdout: Sequence[str] | None) -> tuple[Measurement, Measurement]:
    """(fit runs, held-out runs).

    Args:
        measurement: all runs.
        holdout: names of runs; None for the last third of the runs, or of the only run's time.

    Raises:
        BadInput: an unknown run, or nothing left to fit.
    """
    runs = measurement.runs
    if holdout is None and len(runs) == 1:
        rows = int(measurement.lengths[0])
        cut = (2 * rows) // 3
        if cut < 2 or rows - cut < 2:
            raise BadInput(f"run '{runs[0]}' has {rows} rows", "record at least 6 rows")
        fit = measurement.rows(runs[0], 0, cut)
        return fit, measurement.rows(runs[0], cut, rows, name=f"{runs[0]}{LAST_THIRD}")
    if holdout is None:
        holdout = runs[-(len(runs) // 3 or 1) :]
    for name in holdout:
        if name not in runs:
            raise BadInput(f"holdout run '{name}' is unknown", f"known: {', '.join(runs)}")
    kept = [run for run in runs if run not in set(holdout)]
    if not kept or not holdout:
        raise BadInput(
            "every run is held out" if holdout else "no run is held out", "keep at least one run for each purpose"
        )
    return measurement.select(kept), measurement.select(holdout)
