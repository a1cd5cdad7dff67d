"""Residual and sensitivities of all windows with every window's best start taken out, weighed as the score asks.

Per window, in units of sensor noise, each row times the weight of its signal and band of time,

    A = [ w d sim/d s / sd_bin ; w0 / sd_0 ],   r = [ w residual / sd_bin ; w0 (s_prior - s) / sd_0 ],
    A = Q R,     r~ = r - Q Q' r,     C~ = C - Q Q' C

so that least squares on the rows is least squares over theta and all starts (Golub and Pereyra 1973).

The weights make that least squares a step towards the smallest score (:mod:`.judging.scoring`): a signal counts by the
share of its error that is explained, above the noise, and so does each band of time since the window's start.

    w^2 = 1 / (count (mean square + 1))      of its signal and band
    w0^2 = the mean of w^2                   of a prior from the smoother
    w0^2 = the mean of 1 / (2 count)         of one that was given: it is not loosened where the model errs
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.projection import per_noise, start_looseness, start_misfit
from onlinebayes.identification.fitting.sensitivities import Linearisation

BAND_ENDS = (0.25, 0.5, 1.0)
"""Ends of the bands, as shares of a window: what is slow shows in the last one, what is quick in the first."""

BANDS = len(BAND_ENDS)


@dataclass(frozen=True)
class Rows:
    """W windows of m = n S + J2 rows, the last J2 those of the starts' priors.

    Args:
        residual: r~.
        columns: C~, one a parameter.
        basis, triangle: Q and R of every window.
        weight: w of each bin and signal.
        prior_weight: w0 of each window's start.
    """

    residual: Float[Tensor, "W m"]
    columns: Float[Tensor, "W m P"]
    basis: Float[Tensor, "W m J2"]
    triangle: Float[Tensor, "W J2 J2"]
    weight: Float[Tensor, "n S"]
    prior_weight: Float[Tensor, "W J2"]

    @property
    def objective(self) -> float:
        """Sum of squares of all rows."""
        return float(self.residual.square().sum())

    def in_noise(self, rows: Float[Tensor, "*batch W m"]) -> Float[Tensor, "*batch W n S"]:
        """Measured rows back in units of sensor noise."""
        n, S = self.weight.shape
        return rows[..., : n * S].unflatten(-1, (n, S)) / self.weight


def band_of(bins: int, device: torch.device) -> Int[Tensor, " n"]:
    """Number of the band that each bin lies in."""
    end = (torch.arange(bins, device=device) + 1) / bins
    return torch.bucketize(end, end.new_tensor(BAND_ENDS[:-1]) + 1e-9)


def band_squares(windows: Windows, rows: Float[Tensor, "W n S"]) -> Float[Tensor, "W B S"]:
    """Sum of squares in every window, band and signal."""
    squares = torch.where(windows.seen, rows, torch.zeros_like(rows)).square()
    found = rows.new_zeros(rows.shape[0], BANDS, rows.shape[2])
    return found.index_add(1, band_of(rows.shape[1], rows.device), squares)


def band_counts(windows: Windows) -> Float[Tensor, "W B S"]:
    """Count the observed bins in every window, band and signal."""
    return band_squares(windows, torch.ones_like(windows.bin_noise))


def rms(windows: Windows, rows: Float[Tensor, "W n S"]) -> Float[Tensor, " S"]:
    """Of every signal, over all that was observed."""
    total, count = band_squares(windows, rows).sum((0, 1)), band_counts(windows).sum((0, 1))
    return (total / count.clamp_min(1.0)).sqrt()


def score_weights(windows: Windows, rows: Float[Tensor, "W n S"]) -> Float[Tensor, "n S"]:
    """w of every bin and signal for a residual in units of noise."""
    count = band_counts(windows).sum(0).clamp_min(1.0)
    mean_square = band_squares(windows, rows).sum(0) / count
    return (1 / (count * (mean_square + 1))).sqrt()[band_of(rows.shape[1], rows.device)]


def project(windows: Windows, lin: Linearisation, weight: Float[Tensor, "n S"]) -> Rows:
    """Every window's start taken out of its residual and its sensitivities."""
    prior = _prior_weight(windows, weight)
    scale = per_noise(windows) * weight
    by_start = lin.by_start * windows.free_starts.to(scale)[:, None, None, :] * scale[..., None]
    priors = torch.diag_embed(prior / start_looseness(windows))
    basis, triangle = torch.linalg.qr(torch.cat([by_start.flatten(1, 2), priors], dim=1))
    shift = prior * start_misfit(windows, lin.starts)
    residual = torch.cat([(lin.residual * scale).flatten(1, 2), shift], dim=1)
    residual = residual - (basis @ (basis.mT @ residual[..., None]))[..., 0]
    blank = residual.new_zeros(*residual.shape, 0)
    rows = Rows(residual, blank, basis, triangle, weight, prior)
    return Rows(residual, taken_out(windows, rows, lin.by_theta), basis, triangle, weight, prior)


def _prior_weight(windows: Windows, weight: Float[Tensor, "n S"]) -> Float[Tensor, "W J2"]:
    """w0 of every window's start."""
    of_noise = score_weights(windows, torch.ones_like(windows.bin_noise))
    loose, given = (
        ((one.square() * windows.seen).sum() / windows.seen.sum().clamp_min(1)).sqrt() for one in (weight, of_noise)
    )
    return torch.where(windows.start_given, given, loose)


def taken_out(windows: Windows, rows: Rows, moved: Float[Tensor, "W n S C"]) -> Float[Tensor, "W m C"]:
    """Return the change of the rows where the replay changes, starts taken out again."""
    scaled = (moved * (per_noise(windows) * rows.weight)[..., None]).flatten(1, 2)
    still = scaled.new_zeros(len(scaled), windows.start.shape[1], scaled.shape[2])
    column = torch.cat([scaled, still], dim=1)
    return column - rows.basis @ (rows.basis.mT @ column)


def left_of(windows: Windows, rows: Rows, residual: Float[Tensor, "D W n S"], starts: Float[Tensor, "W J2"]) -> Tensor:
    """The rows (D, W, m) of other residuals [SI] from the fit's starts, these taken out as at the fit."""
    scale, shift = per_noise(windows) * rows.weight, rows.prior_weight * start_misfit(windows, starts)
    full = torch.cat([(residual * scale).flatten(2, 3), shift.expand(len(residual), *shift.shape)], dim=2)
    return full - starts_part(rows, full)


def starts_part(rows: Rows, full: Float[Tensor, "*D W m"]) -> Float[Tensor, "*D W m"]:
    """The part of rows that the windows' starts can do, from right to left: B B^T is m x m a window."""
    return (rows.basis @ (rows.basis.mT @ full[..., None]))[..., 0]


def start_shift(
    windows: Windows, lin: Linearisation, rows: Rows, steps: Float[Tensor, "D P"]
) -> Float[Tensor, "D W J2"]:
    """Compute the shift of all starts, each window to its best one, when theta moves by each of the steps."""
    scale = per_noise(windows) * rows.weight
    left = lin.residual - torch.einsum("wnsp,dp->dwns", lin.by_theta, steps)
    prior = rows.prior_weight * start_misfit(windows, lin.starts)
    full = torch.cat([(left * scale).flatten(2, 3), prior.expand(len(steps), *prior.shape)], dim=2)
    right = torch.einsum("wmj,dwm->dwj", rows.basis, full)
    shift = torch.linalg.solve_triangular(rows.triangle, right[..., None], upper=True)[..., 0]
    return torch.where(windows.free_starts, shift, torch.zeros_like(shift))
