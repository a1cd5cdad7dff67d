"""Smoothed starts of windows: position and velocity from a local cubic, with their standard deviations.

    y(t) = a0 + a1 t + a2 t^2 + a3 t^3 + noise,   |t| <= m h,      q0 = a0, v0 = a1, cov = sd^2 (X' X)^-1

The half-window m is, per signal, the largest one whose chi^2 per degree of freedom stays within 1.2 of the smallest: as
long as the motion allows and no longer (Savitzky and Golay 1964; the choice of m follows Lepskii's balancing).
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from onlinebayes.identification.data.grid import RunGrid

HALF_WINDOWS = (3, 4, 6, 8, 11, 15, 20, 28, 40, 56, 80, 112)
DEGREE = 3
SLACK = 1.2  # times the smallest chi^2 per degree of freedom
LOOKS = 400  # places at which a half-window is tried, about
MOSTLY = 0.9
"""Share of the places at which a half-window must hold more rows than a cubic has coefficients, of the best one's."""


def half_window(grids: Sequence[RunGrid], signal: int) -> int:
    """The half-window m [rows] for one signal.

    Args:
        grids: the runs, all of one spacing.
        signal: column of the signal.
    """
    value = torch.cat([grid.value[:, signal] for grid in grids])
    observed = torch.cat([grid.observed[:, signal] for grid in grids])
    step, stride = grids[0].step, max(1, sum(grid.rows for grid in grids) // LOOKS)
    alive = _alive(observed)
    spreads, shares = [], []
    for m in HALF_WINDOWS:
        rows = _rows_within(grids, m, stride).to(value)
        if not len(rows):
            spreads.append(float("inf"))
            shares.append(0.0)
            continue
        _, _, rest, free = local_cubic(value, observed, rows * step, m, step)
        dof = float(free.sum())
        spreads.append(float(rest.sum()) / dof if dof > 0 else float("inf"))
        shares.append(float((free > 0)[alive[rows.long()]].double().mean().nan_to_num(0.0)))
    # A signal slower than the clock has few rows: a cubic that goes through all of them shows nothing.
    spreads = [s if share >= MOSTLY * max(shares) else float("inf") for s, share in zip(spreads, shares, strict=True)]
    chosen, best = HALF_WINDOWS[0], min(spreads)
    for m, spread in zip(HALF_WINDOWS, spreads, strict=True):
        if spread <= SLACK * best:
            chosen = m
    return chosen


def _alive(observed: Bool[Tensor, " G1"]) -> Bool[Tensor, " G1"]:
    """Rows no further from an observed one than these are from one another: a hole, which a half-window would have to
    span, says nothing of how many rows it should hold."""
    at = observed.nonzero()[:, 0]
    if len(at) < 2:
        return torch.ones_like(observed)
    rows = torch.arange(len(observed), device=observed.device)
    after = torch.searchsorted(at, rows).clamp_max(len(at) - 1)
    nearest = torch.minimum((at[after] - rows).abs(), (at[(after - 1).clamp_min(0)] - rows).abs())
    return nearest <= at.diff().median()


def _rows_within(grids: Sequence[RunGrid], m: int, stride: int) -> Int[Tensor, " L"]:
    """Rows ``stride`` apart with ``m`` more of their own run on either side, counted through all runs."""
    begin, found = 0, []
    for grid in grids:
        if grid.rows + 1 - m > m:
            found.append(begin + torch.arange(m, grid.rows + 1 - m, stride, device=grid.value.device))
        begin += grid.rows + 1
    return torch.cat(found) if found else torch.zeros(0, dtype=torch.long, device=grids[0].value.device)


def local_cubic(
    value: Float[Tensor, " G1"], observed: Bool[Tensor, " G1"], at: Float[Tensor, " W"], m: int, step: float
) -> tuple[Float[Tensor, "W 2"], Float[Tensor, "W 2"], Float[Tensor, " W"], Float[Tensor, " W"]]:
    """Position and velocity at the instants ``at`` from the observed rows of the 2 m + 1 around them.

    Args:
        value, observed: one signal on an even clock of spacing ``step`` [s] that starts at 0.
        at: instants [s].
        m: half-window [rows].
        step: of the clock [s].

    Returns:
        (q, v) at each instant [unit, unit/s]; their sd for sensor noise of sd 1; residual sum of squares; degrees of
        freedom. An instant with fewer than 5 observed rows gets an infinite sd.
    """
    # Near an end the stretch of 2 m + 1 rows is moved inside, and read off its middle.
    last = len(value) - 1
    centres = torch.round(at / step).long().clamp(min(m, last // 2), max(last - m, last // 2))
    offsets = torch.arange(-m, m + 1, device=value.device)
    index = centres[:, None] + offsets
    inside = (index >= 0) & (index < len(value))
    index = index.clamp(0, len(value) - 1)
    weight = (inside & observed[index]).to(value.dtype)
    # About the central row and in units of the half-window: one set of powers for all instants, X' X well conditioned.
    x = (offsets.to(value) / m)[:, None] ** torch.arange(DEGREE + 1, device=value.device)
    normal = (weight @ (x[:, :, None] * x[:, None, :]).flatten(1)).unflatten(1, (DEGREE + 1, DEGREE + 1))
    y = value[index]
    middle = y[:, m : m + 1]  # relative to the centre: small numbers, no cancellation
    right = (weight * (y - middle)) @ x
    enough = weight.sum(-1) > DEGREE + 1
    eye = torch.eye(DEGREE + 1, dtype=value.dtype, device=value.device)
    normal = torch.where(enough[:, None, None], normal, eye)
    covariance = torch.linalg.inv(normal + 1e-12 * eye)
    a = (covariance @ right[:, :, None])[..., 0]
    rest = (weight * (y - middle - a @ x.T) ** 2).sum(-1)
    read = _value_and_slope((at / step - centres) / m)
    scale = torch.tensor([1.0, 1.0 / (m * step)], dtype=value.dtype, device=value.device)
    state = (read @ a[:, :, None])[..., 0] * scale
    state = torch.stack([state[:, 0] + middle[:, 0], state[:, 1]], -1)
    sd = (read @ covariance @ read.mT).diagonal(dim1=-2, dim2=-1).sqrt() * scale
    sd = torch.where(enough[:, None], sd, torch.full_like(sd, float("inf")))
    return state, sd, torch.where(enough, rest, 0.0), torch.where(enough, weight.sum(-1) - (DEGREE + 1), 0.0)


def _value_and_slope(at: Float[Tensor, " W"]) -> Float[Tensor, "W 2 powers"]:
    """Return the factors of a cubic's coefficients that give its value and its slope at each place."""
    power = torch.arange(DEGREE + 1, device=at.device)
    value = at[:, None] ** power
    slope = power * torch.cat([torch.zeros_like(value[:, :1]), value[:, :-1]], -1)
    return torch.stack([value, slope], 1)
