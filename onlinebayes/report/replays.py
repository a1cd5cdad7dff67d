"""The replays as arrays for drawing: measured, simulated before and after, and the window in which it shows most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from onlinebayes.criticism import Criticism
from onlinebayes.identification import ReplayedRun

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Trace:
    """One signal of one run.

    Args:
        run: its name.
        held_out: whether it was kept from the fit.
        time: (T,) [s].
        measured: (T,) nan where not measured [the signal's unit].
        before, after: (T,) simulated by the base and by the final model, restarted at each window.
        window: (T,) number of the window that a row belongs to.
    """

    run: str
    held_out: bool
    time: Array
    measured: Array
    before: Array
    after: Array
    window: NDArray[np.int64]

    def rows(self, keep: NDArray[np.bool_]) -> Trace:
        """Some of the rows."""
        names = ("time", "measured", "before", "after", "window")
        return replace(self, **{name: getattr(self, name)[keep] for name in names})

    def broken(self, values: Array) -> Array:
        """``values`` with a nan at the start of each window but the first, so that lines do not join windows."""
        found = values.copy()
        found[1:][np.diff(self.window) != 0] = np.nan
        return found


GAP = 3.0
"""Times the usual distance between a signal's rows: a longer one is a gap, and breaks a line."""


def traces(result: Criticism, signal: str) -> list[Trace]:
    """One signal in all runs, held-out runs first."""
    column = result.signals.index(signal)
    pairs = zip(result.base.replays, result.final.replays, strict=True)
    found = [_trace(before, after, column) for before, after in pairs]
    return sorted(found, key=lambda trace: not trace.held_out)


def traces_to_judge(all_traces: Sequence[Trace]) -> list[Trace]:
    """The traces to judge by: the held-out ones, or all where none were opened."""
    return [trace for trace in all_traces if trace.held_out] or list(all_traces)


def worst_window(all_traces: Sequence[Trace]) -> Trace | None:
    """The rows of the window in which the base model is furthest off in the root mean square, or None without rows."""
    return next(iter(worst_windows(all_traces, 1)), None)


def worst_windows(all_traces: Sequence[Trace], count: int) -> list[Trace]:
    """The ``count`` windows in which the base model is furthest off in the root mean square, the worst first."""
    found: list[tuple[float, Trace]] = []
    for trace in traces_to_judge(all_traces):
        squared = (trace.before - trace.measured) ** 2
        for number in np.unique(trace.window):
            inside = (trace.window == number) & np.isfinite(squared)
            if inside.sum() > 2:
                found.append((float(squared[inside].mean()), trace.rows(trace.window == number)))
    found.sort(key=lambda item: -item[0])
    return [trace for _, trace in found[:count]]


def _trace(before: ReplayedRun, after: ReplayedRun, column: int) -> Trace:
    def array(values: object) -> Array:
        return np.asarray(values, dtype=np.float64)

    trace = Trace(
        run=before.run,
        held_out=before.held_out,
        time=array(before.time.cpu()),
        measured=array(before.measured[:, column].cpu()),
        before=array(before.simulated[:, column].cpu()),
        after=array(after.simulated[:, column].cpu()),
        window=np.asarray(before.window.cpu(), dtype=np.int64),
    )
    return trace.rows(_drawn(trace.time, np.isfinite(trace.measured)))


def _drawn(time: Array, seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Rows with a measurement, and those in gaps; the model may have rows between the log's, where a line goes on."""
    if seen.sum() < 2:
        return np.ones_like(seen)
    rows = time[seen]
    place = np.searchsorted(rows, time).clip(1, len(rows) - 1)
    return seen | (rows[place] - rows[place - 1] > GAP * np.median(np.diff(rows)))
