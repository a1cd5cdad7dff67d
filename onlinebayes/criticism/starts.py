"""The state in which each window starts, smoothed from what was measured, and which joints move in it at all.

A joint that moves less than 8 sensor sd in a window starts at the window's median, at rest, and is not freed there.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.criticism.grid import RunGrid
from onlinebayes.criticism.smoother import half_window, local_cubic

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
        s = names.index(f"qpos.{joint}")
        m = half_window(grids, s)
        for r, grid in enumerate(grids):
            mine = [w for w, cut in enumerate(cuts) if cut[0] == r]
            begins = torch.tensor([cuts[w][1] for w in mine], dtype=noise.dtype, device=noise.device)
            local, spread, _, _ = local_cubic(grid.value[:, s], grid.observed[:, s], begins, m, grid.step)
            for k, w in enumerate(mine):
                rows = slice(round(cuts[w][1] / grid.step), round(cuts[w][2] / grid.step) + 1)
                y = grid.value[rows, s][grid.observed[rows, s]]
                moved = float(y.max() - y.min()) if len(y) else 0.0
                if moved >= STILL * float(noise[s]):
                    known = bool(torch.isfinite(spread[k]).all())
                    # With too few rows about the start, all that is known is where in the window's range it lies.
                    vague = torch.tensor([moved, moved / (cuts[w][2] - cuts[w][1])]).to(noise)
                    guess = torch.stack([y[0], torch.zeros_like(y[0])])
                    start[w, [j, J + j]], free[w, j] = (local[k] if known else guess), True
                    sd[w, [j, J + j]] = spread[k] * noise[s] if known else vague
                elif len(y):
                    start[w, j] = y.median()
                    sd[w, [j, J + j]] = noise[s]
    return start, sd, free
