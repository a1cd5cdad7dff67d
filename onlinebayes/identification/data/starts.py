"""The state in which each window starts, smoothed from what was measured, and which joints move in it at all.

A joint that moves less than 8 sensor sd in a window starts at the window's median, at rest, and is not freed there.
Beside other joints it is, where a cubic in time follows it significantly better than rest: a ball that creeps along a
beam pulls at it all the same, and a finer sensor than its own sees that,

    n (var y - var of what the cubic leaves) / sd^2 > 12        chi2 of 3 degrees exceeds 12 with probability 0.7 %

Of a joint that is seen by its velocity alone (see :mod:`.motion`) the velocity is smoothed, and its position is what
the velocity adds up to since the run began.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.identification.data.grid import RunGrid
from onlinebayes.identification.data.motion import seen_by
from onlinebayes.identification.data.smoother import half_window, local_cubic

STILL = 8.0
CREEPS = 12.0


def window_starts(
    grids: Sequence[RunGrid],
    cuts: Sequence[tuple[int, float, float]],
    names: Sequence[str],
    joints: Sequence[str],
    noise: Float[Tensor, " S"],
) -> tuple[Float[Tensor, "W J2"], Float[Tensor, "W J2"], Bool[Tensor, "W J"]]:
    """Smoothed starts, their sd, and which joints move, for windows (run, from, to) [s] and all joints."""
    W, J = len(cuts), len(joints)
    start = torch.zeros(W, 2 * J, dtype=noise.dtype, device=noise.device)
    sd, free = torch.zeros_like(start), torch.zeros(W, J, dtype=torch.bool, device=noise.device)
    for j, joint in enumerate(joints):
        seen = seen_by(joint, names)
        s, places = seen.column, [j, J + j]
        m = half_window(grids, s)
        for r, grid in enumerate(grids):
            mine = [w for w, cut in enumerate(cuts) if cut[0] == r]
            begins = torch.tensor([cuts[w][1] for w in mine], dtype=noise.dtype, device=noise.device)
            local, spread, _, _ = local_cubic(grid.value[:, s], grid.observed[:, s], begins, m, grid.step)
            if not seen.position:
                travelled = _integral(grid, s)
            for k, w in enumerate(mine):
                rows = slice(round(cuts[w][1] / grid.step), round(cuts[w][2] / grid.step) + 1)
                shown = grid.observed[rows, s]
                y = grid.value[rows, s][shown]
                if seen.position:
                    creeps = J > 1 and _creeps(shown.nonzero()[:, 0].to(y), y, noise[s])
                    found = _by_position(y, local[k], spread[k], noise[s], cuts[w][2] - cuts[w][1], creeps)
                else:
                    found = _by_velocity(y, travelled[rows.start], local[k, 0], spread[k, 0], noise[s])
                start[w, places], sd[w, places], free[w, j] = found
    return start, sd, free


def _by_position(
    y: Float[Tensor, " n"],
    local: Float[Tensor, " 2"],
    spread: Float[Tensor, " 2"],
    noise: Float[Tensor, ""],
    horizon: float,
    creeps: bool,
) -> tuple[Float[Tensor, " 2"], Float[Tensor, " 2"], bool]:
    """(q0, v0), their sd, and whether the joint moves.

    Args:
        y: positions measured in the window [m, rad].
        local, spread: the cubic's position and velocity at its first instant, and their sd for noise of sd 1.
        noise: of the sensor [m, rad].
        horizon: length of the window [s].
        creeps: whether it moves though by less than 8 sd.
    """
    nothing = torch.zeros_like(local)
    if not len(y):
        return nothing, nothing, False
    moved = y.max() - y.min()
    if not creeps and not bool(moved >= STILL * noise):
        return torch.stack([y.median(), nothing[0]]), noise.expand(2), False
    if bool(torch.isfinite(spread).all()):
        return local, spread * noise, True
    # With too few rows about the start, all that is known is where in the window's range it lies.
    return torch.stack([y[0], nothing[0]]), torch.stack([moved, moved / horizon]), True


def _creeps(row: Float[Tensor, " n"], y: Float[Tensor, " n"], noise: Float[Tensor, ""]) -> bool:
    """Check whether a cubic in time follows positions significantly better than their mean does."""
    if len(y) < 5:
        return False
    powers = torch.linalg.vander(row / row[-1].clamp_min(1), N=4)  # that of 0 first
    basis = torch.linalg.qr(powers)[0][:, 1:]
    return float((basis.T @ y).square().sum() / noise.square()) > CREEPS


def _by_velocity(
    y: Float[Tensor, " n"],
    travelled: Float[Tensor, ""],
    local: Float[Tensor, ""],
    spread: Float[Tensor, ""],
    noise: Float[Tensor, ""],
) -> tuple[Float[Tensor, " 2"], Float[Tensor, " 2"], bool]:
    """(q0, v0), their sd, and whether the joint moves; arguments as :func:`_by_position`, of velocities [m/s, rad/s].

    Nothing depends on q0, so that any sd leaves it where it is.
    """
    rest = torch.zeros_like(noise)
    if not len(y) or not bool(y.abs().max() >= STILL * noise):
        return torch.stack([travelled, rest]), noise.expand(2), False
    if bool(torch.isfinite(spread)):
        return torch.stack([travelled, local]), torch.stack([noise, spread * noise]), True
    return torch.stack([travelled, y[0]]), torch.stack([noise, y.abs().max()]), True


def _integral(grid: RunGrid, signal: int) -> Float[Tensor, " G1"]:
    """Of a velocity from the run's first row, by trapezoids; rows without a value hold the last one [m, rad]."""
    rows = torch.arange(grid.rows + 1, device=grid.value.device)
    last = torch.where(grid.observed[:, signal], rows, -1).cummax(0)[0]
    v = torch.where(last >= 0, grid.value[last.clamp_min(0), signal], 0.0)
    steps = 0.5 * grid.step * (v[1:] + v[:-1])
    return torch.cat([steps.new_zeros(1), steps.cumsum(0)])
