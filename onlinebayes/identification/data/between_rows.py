"""Commands between the rows of a log that sent them more often than it wrote rows: a curve through the rows.

    u(t_i + s d) = h00 u_i + h10 d m_i + h01 u_{i+1} + h11 d m_{i+1},    d = t_{i+1} - t_i,  0 <= s <= 1
    m_i = mean of the slopes on both sides, or that of the side without a jump

with Hermite's cubics h (Catmull and Rom 1974). Held until the next row, a command that went on comes late by half a
row. A straight line errs by d^2 / 8 times the second derivative: goals at 2 Hz logged at 50 Hz left two noise floors.
Of a jump nobody knows when it was: no curve leads across, and the run is parted there (:func:`.lost_rows.jumps`).
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

PARTS = 8
"""Pieces of constant command that stand for the curve from one row to the next."""


def curve_through(
    time: Float[Tensor, " T"], command: Float[Tensor, "T U"], jumps: Bool[Tensor, " T_1"]
) -> tuple[Float[Tensor, " N"], Float[Tensor, "N U"]]:
    """Instants and commands, each held until the next instant, that follow the curve.

    Args:
        time: of a run's rows [s].
        command: of them [command units].
        jumps: between which rows it jumps; there it is held.
    """
    apart = time.diff()
    if not len(apart):
        return time, command
    smooth = (~jumps).to(command)[:, None]
    slope = smooth * command.diff(dim=0) / apart[:, None]
    none = torch.zeros_like(slope[:1])
    sides = torch.cat([none[:, :1], smooth]) + torch.cat([smooth, none[:, :1]])
    at_rows = (torch.cat([none, slope]) + torch.cat([slope, none])) / sides.clamp_min(1)
    begin = torch.arange(PARTS, device=time.device).to(time) / PARTS
    s = (begin + 0.5 / PARTS)[:, None]
    first, rise = command[:-1, None], (smooth * command.diff(dim=0))[:, None]
    m0, m1 = (apart[:, None, None] * torch.where(smooth > 0, m, 0.0)[:, None] for m in (at_rows[:-1], at_rows[1:]))
    curve = first + s**2 * (3 - 2 * s) * rise + s * (1 - s) ** 2 * m0 - s**2 * (1 - s) * m1
    at = time[:-1, None] + begin * apart[:, None]
    return torch.cat([at.flatten(), time[-1:]]), torch.cat([curve.flatten(0, 1), command[-1:]])
