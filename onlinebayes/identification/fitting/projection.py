"""Starts projected out: what is left of residuals and sensitivities once every window has had its best start.

Per window, in units of sensor noise, with the start's prior as further rows,

    A = [ d sim/d s / sd_bin ; 1 / sd_0 ],   r = [ residual / sd_bin ; (s_prior - s) / sd_0 ],
    A = Q R,   x~ = x - Q Q' x   for x = r and for every column d sim/d theta / sd_bin

with sd_0 the prior's sd (see ``data.start_priors``), so that least squares on x~ is the joint least squares over theta
and all starts (variable projection, Golub and Pereyra 1973). Then each signal is weighed by 1 / RMS of the current
residual, at least its noise.

A short horizon needs no simulation of its own: the start columns of the long window, restricted to some of its bins,
span what a start of those bins would do. ``pieces`` cuts each window into that many short ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.sensitivities import Linearisation


@dataclass(frozen=True)
class Projected:
    """Start-projected, weighed rows: V windows (or pieces of them) of m = n S + J2 rows, the last J2 the priors'.

    Args:
        residual: r~ [weighed noise units].
        columns: one per theta, and per candidate where there are some.
        weight: what each signal's noise units were multiplied by.
        row_weight: the same for every row; 0 for rows without an observation.
        basis, triangle: Q and R of each window.
        bins, signals: n and S, to take the rows apart again.
    """

    residual: Float[Tensor, "V m"]
    columns: Float[Tensor, "V m P"]
    weight: Float[Tensor, " S"]
    row_weight: Float[Tensor, "V m"]
    basis: Float[Tensor, "V m J2"]
    triangle: Float[Tensor, "V J2 J2"]
    bins: int
    signals: int

    @property
    def objective(self) -> float:
        """Sum of squares of the rows."""
        return float(self.residual.square().sum())

    def measured_rows(self, rows: Float[Tensor, "*batch V m"]) -> Float[Tensor, "*batch V n S"]:
        """The rows without the priors', by bin and signal, still in weighed noise units."""
        return rows[..., : self.bins * self.signals].unflatten(-1, (self.bins, self.signals))

    def seen(self) -> Bool[Tensor, "V n S"]:
        """Return a mask of the observed bins."""
        return self.measured_rows(self.row_weight) > 0

    def project(self, columns: Float[Tensor, "V m C"]) -> Float[Tensor, "V m C"]:
        """Columns in noise units, priors' rows included, treated as those of theta."""
        return (columns - self.basis @ (self.basis.mT @ columns)) * self.row_weight[..., None]


def project(
    windows: Windows, lin: Linearisation, weight: Float[Tensor, " S"] | None = None, pieces: int = 1
) -> Projected:
    """Project the starts out of a linearisation.

    Args:
        windows: W windows.
        lin: the linearisation of their replay.
        weight: of each signal, relative to its noise; 1 when None.
        pieces: short windows per long one; V = W * pieces.
    """
    if weight is None:
        weight = torch.ones_like(windows.noise)
    n = windows.bins // pieces
    J2 = windows.start.shape[1]
    scale = _cut(per_noise(windows), pieces)
    by_start = _cut(lin.by_start * windows.free_starts.to(scale)[:, None, None, :], pieces) * scale[..., None]
    priors = torch.diag_embed(1 / start_looseness(windows)).repeat_interleave(pieces, 0)
    starts = torch.cat([by_start, priors], dim=1)
    basis, triangle = torch.linalg.qr(starts)
    # A piece has a start of its own, about which the long window's prior says nothing beyond its width.
    shift = start_misfit(windows, lin.starts) if pieces == 1 else windows.start.new_zeros(starts.shape[0], J2)
    residual = torch.cat([_cut(lin.residual, pieces) * scale, shift], dim=1)
    row_weight = row_weights(windows, weight, pieces)
    projected = Projected(
        (residual - (basis @ (basis.mT @ residual[..., None]))[..., 0]) * row_weight,
        residual.new_zeros(*residual.shape, 0),
        weight,
        row_weight,
        basis,
        triangle,
        n,
        len(windows.noise),
    )
    return replace_columns(projected, windows, lin.by_theta, pieces)


def _cut(by_bin: Float[Tensor, "W bins S ..."], pieces: int) -> Float[Tensor, "V nS ..."]:
    """Every window's bins in so many pieces of n bins each, those that are over left out: V = W * pieces."""
    n = by_bin.shape[1] // pieces
    return by_bin[:, : n * pieces].unflatten(1, (pieces, n)).flatten(0, 1).flatten(1, 2)


def per_noise(windows: Windows) -> Float[Tensor, "W n S"]:
    """Return the factor from a bin's SI unit to noise units: 1 / sd of its average, 0 where nothing was observed."""
    return torch.where(windows.seen, 1 / windows.bin_noise, torch.zeros_like(windows.bin_noise))


def row_weights(windows: Windows, weight: Float[Tensor, " S"], pieces: int = 1) -> Float[Tensor, "V m"]:
    """Return each row's weight in noise units: its signal's weight where it was observed, the mean one for the priors.

    A prior that was given counts for what it says.
    """
    seen = _cut(windows.seen * weight, pieces)
    priors = torch.where(windows.start_given, torch.ones_like(windows.start), weight.mean())
    return torch.cat([seen, priors.repeat_interleave(pieces, 0)], dim=1)


def start_looseness(windows: Windows) -> Float[Tensor, "W J2"]:
    """Prior sd of the starts [SI]; 1 for those that are not freed."""
    return torch.where(windows.free_starts, windows.start_prior, torch.ones_like(windows.start_prior))


def start_misfit(windows: Windows, starts: Float[Tensor, "*batch W J2"]) -> Float[Tensor, "*batch W J2"]:
    """The priors' rows: how far the starts are below the smoothed ones, in prior sd."""
    return (windows.start - starts) / start_looseness(windows)


def noise_rows(windows: Windows, by_theta: Float[Tensor, "W n S C"], pieces: int = 1) -> Float[Tensor, "V m C"]:
    """Sensitivities as rows in noise units with the priors' rows (zero: theta does not move a start's prior)."""
    rows = _cut(by_theta * per_noise(windows)[..., None], pieces)
    return torch.cat([rows, rows.new_zeros(rows.shape[0], windows.start.shape[1], rows.shape[2])], dim=1)


def replace_columns(
    projected: Projected, windows: Windows, by_theta: Float[Tensor, "W n S C"], pieces: int = 1
) -> Projected:
    """The same projection with other columns."""
    return replace(projected, columns=projected.project(noise_rows(windows, by_theta, pieces)))


def start_shift(
    windows: Windows, lin: Linearisation, projected: Projected, step: Float[Tensor, " P"]
) -> Float[Tensor, "W J2"]:
    """Compute the shift of the starts when theta moves by ``step``: the linearised replay's least-squares starts."""
    rows = noise_rows(windows, lin.residual[..., None] - (lin.by_theta @ step)[..., None])[..., 0]
    rows[:, -windows.start.shape[1] :] = start_misfit(windows, lin.starts)
    right = projected.basis.mT @ rows[..., None]
    shift = torch.linalg.solve_triangular(projected.triangle, right, upper=True)[..., 0]
    return torch.where(windows.free_starts, shift, torch.zeros_like(shift))


def signal_rms(projected: Projected) -> Float[Tensor, " S"]:
    """Start-projected RMS of each signal [noise units of a bin]."""
    rows, seen = projected.measured_rows(projected.residual), projected.seen()
    total = rows.square().sum((0, 1)) / seen.sum((0, 1)).clamp_min(1)
    return total.sqrt() / projected.weight


def misfit(projected: Projected) -> float:
    """Start-projected RMS of the signal that is missed most [noise units of a bin]."""
    return float(signal_rms(projected).max())
