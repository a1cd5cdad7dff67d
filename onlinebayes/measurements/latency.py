"""A column that lags: what a row shows had happened ``latency`` seconds before it was written.

    y(t_i) = c_j + dc/dt_j (t_i - (t_j - L)),      i the row that the measured cell j goes to, at its instant t_j - L

A cell goes to the row nearest to its instant, and to one row only: two rows would count one reading twice. It must lie
within half a cell's spacing of that row (the run's last L seconds were not measured, for one), or the row between two
neighbours on a clock that jitters: with a latency of half a row, every row lies in the middle, and all cells go to the
row before theirs, or to the one after it, where that leaves fewer of them without a row. One cell is moved along its
local slope, as the replay's even clock does, so that the sensor's noise is not averaged away. The spacing is that of
the column's own cells: commands on a clock of their own make rows in between.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

JITTER = 1.5
"""Spacings by which two neighbouring cells may be apart; more, and one is missing between them."""


def advanced(
    time: Float[np.ndarray, " T"], column: Float[np.ndarray, " T"], latency: float | Float[np.ndarray, " T"]
) -> Float[np.ndarray, " T"]:
    """The column as it would read without its latency [its unit], nan where that is not known.

    Args:
        time: of the rows [s].
        column: as logged, nan where not measured.
        latency: L, of all rows or of each, negative for a column that is stamped too late [s].
    """
    cells = np.flatnonzero(~np.isnan(column))
    if not np.any(latency) or len(cells) < 2:
        return column
    t, c = (time - latency)[cells], column[cells]
    rows, placed = _placed(time, t)
    slope = np.gradient(c, t)
    moved = np.full(len(time), np.nan)
    moved[rows[placed]] = (c + slope * (time[rows] - t))[placed]
    return moved


def _placed(
    time: Float[np.ndarray, " T"], t: Float[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """The row of each instant, none twice, and whether it has one."""
    step, k = np.median(np.diff(t)), np.arange(len(t))
    right = np.clip(np.searchsorted(t, time), 1, len(t) - 1)
    between = (t[right - 1] <= time) & (time <= t[right]) & (t[right] - t[right - 1] <= JITTER * step)
    inside = (time[0] <= t) & (t <= time[-1])
    after = np.clip(np.searchsorted(time, t), 1, len(time) - 1)
    nearest = np.where(t - time[after - 1] <= time[after] - t, after - 1, after)
    alone = np.ones(len(t), dtype=bool)
    order = np.lexsort((np.abs(time[nearest] - t), nearest))
    alone[order[1:][np.diff(nearest[order]) == 0]] = False
    onwards = np.maximum.accumulate(nearest - k) + k  # no row twice: a taken one pushes to the next
    back = np.minimum.accumulate((nearest - k)[::-1])[::-1] + k
    found = []
    for rows, kept in ((nearest, alone), (onwards, onwards < len(time)), (back, back >= 0)):
        rows = np.clip(rows, 0, len(time) - 1)
        offset = np.abs(time[rows] - t)
        placed = kept & ((offset <= 0.5001 * step) | (between[rows] & inside))
        found.append((float(np.where(placed, offset, step).sum()), rows, placed))
    _, rows, placed = min(found, key=lambda one: one[0])
    return rows, placed
