"""The state in which each window starts, smoothed from what was measured, and which joints move in it at all.

A joint that moves less than 8 sensor sd in a window starts at the window's median, at rest, and is not freed there.
Of a joint that is seen by its velocity alone (see :mod:`.motion`) the velocity is smoothed, and its position is what
the velocity adds up to since the run began.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.criticism.data.grid import RunGrid
from onlinebayes.criticism.data.motion import seen_by
from onlinebayes.criticism.data.smoother import half_window, local_cubic

STILL = 8.0


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
                y = grid.value[rows, s][grid.observed[rows, s]]
                if seen.position:
                    found = _by_position(y, local[k], spread[k], noise[s], cuts[w][2] - cuts[w][1])
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
) -> tuple[Float[Tensor, " 2"], Float[Tensor, " 2"], bool]:
    """(q0, v0), their sd, and whether the joint moves.

    Args:
        y: positions measured in the window [m, rad].
        local, spread: the cubic's position and velocity at its first instant, and their sd for noise of sd 1.
        noise: of the sensor [m, rad].
        horizon: length of the window [s].
    """
    nothing = torch.zeros_like(local)
    if not len(y):
        return nothing, nothing, False
    moved = y.max() - y.min()
    if not bool(moved >= STILL * noise):
        return torch.stack([y.median(), nothing[0]]), noise.expand(2), False
    if bool(torch.isfinite(spread).all()):
        return local, spread * noise, True
    # With too few rows about the start, all that is known is where in the window's range it lies.
    return torch.stack([y[0], nothing[0]]), torch.stack([moved, moved / horizon]), True


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
