"""The noise of the sensors, and the time over which the residual is correlated.

| quantity                 | equation                                               | code                     |
|--------------------------|--------------------------------------------------------|--------------------------|
| sensor sd                | clipped RMS of fourth differences of norm 1            | :func:`sensor_sd`        |
| correlation time tau [s] | Delta (1 + 2 sum_k rho_k), summed until rho_k <= .02   | :func:`correlation_time` |

A fourth difference d = sum_i c_i y_i, c_i = prod_{j != i} 1 / (t_i - t_j) over five measured rows in a row, scaled to
sum c_i^2 = 1, has the noise's variance; a cubic has none. On an even clock c is (1, -4, 6, -4, 1) / sqrt(70).
No autoregressive whitening: it would absorb the missing force.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.identification.data.grid import RunGrid, row_step, run_grids
from onlinebayes.measurements import Measurement, Signal

CLIP = 4.0  # RMS, beyond which a fourth difference is an outlier
NEGLIGIBLE = 0.02  # autocorrelation, at which the sum of the correlation time ends


def sensor_sd(grids: Sequence[RunGrid], signal: int) -> float:
    """High-frequency estimate of one signal's noise sd [its unit]; 0 where no run has five measured rows.

    A slow signal is measured in every n-th row only: its neighbours are the rows before and after that have one.
    """
    parts = [_fourth(grid, signal) for grid in grids]
    if not parts or not (kept := torch.cat(parts)).numel():
        return 0.0
    for _ in range(20):
        limit = CLIP * float(kept.square().mean().sqrt())
        inside = kept[kept.abs() <= limit]
        if inside.numel() in (0, kept.numel()):
            break
        kept = inside
    return float(kept.square().mean().sqrt())


def _fourth(grid: RunGrid, signal: int) -> Float[Tensor, " n"]:
    """Fourth differences of norm 1 over neighbouring measured rows; none across a gap of the log."""
    row = torch.nonzero(grid.observed[:, signal])[:, 0]
    y = grid.value[row, signal]
    if len(row) < 5:
        return y[:0]
    t, y = row.to(y).unfold(0, 5, 1), y.unfold(0, 5, 1)
    for before, after in grid.pauses:
        y = y[~((t[:, 0] <= before) & (t[:, 4] >= after))]
        t = t[~((t[:, 0] <= before) & (t[:, 4] >= after))]
    apart = t[:, :, None] - t[:, None, :] + torch.eye(5, dtype=t.dtype, device=t.device)
    c = 1 / apart.prod(-1)
    return (c * y).sum(-1) / c.norm(dim=-1)


def noise_floors(signals: Sequence[Signal], grids: Sequence[RunGrid]) -> Float[Tensor, " S"]:
    """Noise floor of each signal [its unit]: its sd, estimated when not given, at least resolution / sqrt(12)."""
    values = []
    for s, signal in enumerate(signals):
        sd = sensor_sd(grids, s) if signal.sd is None else signal.sd
        quantum = (signal.resolution or 0.0) / math.sqrt(12)
        largest = max((float(grid.value[:, s].abs().max()) for grid in grids), default=1.0)
        # A noise-free simulated record still has rounding: a floor of zero would divide by nothing.
        values.append(max(sd, quantum, 1e-9 * max(largest, 1e-3)))
    return torch.tensor(values, dtype=torch.float64)


def measured_floors(measurement: Measurement) -> Float[Tensor, " S"]:
    """Noise floor of each signal of a measurement [its unit], in the measurement's dtype and on its device."""
    grids = run_grids(measurement, row_step(measurement))
    return noise_floors(measurement.signals, grids).to(measurement.data["signal"])


FEW_PAIRS = 0.1
"""Share of a signal's bins: a lag with fewer pairs of them than this, for its length, says nothing."""


def correlation_time(residual: Float[Tensor, "W n S"], observed: Bool[Tensor, "W n S"], step: float) -> float:
    """Correlation time of the residual within windows [s], the longest of the signals'; at least ``step``.

    Args:
        residual: start-projected residual of each window.
        observed: which bins count.
        step: Delta, the bin [s].
    """
    longest = step
    for s in range(residual.shape[-1]):
        r = torch.where(observed[..., s], residual[..., s], torch.zeros_like(residual[..., s]))
        total = float(r.square().sum())
        if total <= 0:
            continue
        count, rho_sum, known, n = float(observed[..., s].sum()), 0.0, 0, r.shape[1]
        for k in range(1, n):
            pairs = float((observed[:, k:, s] & observed[:, :-k, s]).sum())
            if pairs <= FEW_PAIRS * count * (n - k) / n:  # of a sensor slower than the bins: the next lag stands for it
                continue
            rho = float((r[:, k:] * r[:, :-k]).sum()) / pairs / (total / count)
            if rho <= NEGLIGIBLE:
                break
            rho_sum, known = rho_sum + rho * (k - known), k
        longest = max(longest, step * (1 + 2 * rho_sum))
    return longest
