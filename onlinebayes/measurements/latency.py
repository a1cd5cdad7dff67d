"""A column that lags: what a row shows had happened ``latency`` seconds before it was written.

    y(t_i) = c_j + dc/dt_j (t_i - (t_j - L)),      j the measured cell whose shifted instant t_j - L is nearest to t_i

A row without a shifted cell within half a row was not measured (the run's last L seconds, for one), unless it lies
between two neighbours on a clock that jitters: with a latency of half a row, every row lies in the middle. One cell is
moved along its local slope, as the replay's even clock does, so that the sensor's noise is not averaged away.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

JITTER = 1.5
"""Rows by which two neighbouring cells may be apart; more, and one is missing between them."""


def advanced(time: Float[np.ndarray, " T"], column: Float[np.ndarray, " T"], latency: float) -> Float[np.ndarray, " T"]:
    """The column as it would read without its latency [its unit], nan where that is not known.

    Args:
        time: of the rows [s].
        column: as logged, nan where not measured.
        latency: L, negative for a column that is stamped too late [s].
    """
    cells = np.flatnonzero(~np.isnan(column))
    if latency == 0 or len(cells) < 2:
        return column
    t, c = time[cells] - latency, column[cells]
    slope = np.gradient(c, t)
    right = np.clip(np.searchsorted(t, time), 1, len(t) - 1)
    nearest = np.where(time - t[right - 1] < t[right] - time, right - 1, right)
    offset = time - t[nearest]
    step = np.median(np.diff(time))
    between = (t[right - 1] <= time) & (time <= t[right]) & (t[right] - t[right - 1] <= JITTER * step)
    return np.where((np.abs(offset) <= 0.5001 * step) | between, c[nearest] + slope[nearest] * offset, np.nan)
