"""A replay read where the sensor was: phi rows after each row, by the parabola through three rows.

    s(t_g + phi h) = s_g + phi (s_{g+1} - s_{g-1}) / 2 + phi^2 (s_{g+1} - 2 s_g + s_{g-1}) / 2,    abs(phi) <= 1/2

It errs by less than h^3 / 16 times the third derivative, and by h^2 / 16 times a jump of the second, as between two
commands. Moving the measured values to the rows instead takes their slope from neighbours that lie a whole row of the
sensor away, and adds noise: right models were accused for it. The first and the last row take their neighbour's
parabola; windows of fewer than three rows are read at their rows.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def read_late(rows: Float[Tensor, "M W K S"], late: Float[Tensor, "W K S"]) -> Float[Tensor, "M W K S"]:
    """Simulated signals ``late`` rows after their rows."""
    if rows.shape[-2] < 3:
        return rows
    first, last = rows[..., :3, :], rows[..., -3:, :]
    before = 3 * first[..., :1, :] - 3 * first[..., 1:2, :] + first[..., 2:, :]
    after = 3 * last[..., 2:, :] - 3 * last[..., 1:2, :] + last[..., :1, :]
    return _parabola(torch.cat([before, rows[..., :-1, :]], -2), rows, torch.cat([rows[..., 1:, :], after], -2), late)


def _parabola(back: Tensor, at: Tensor, on: Tensor, late: Tensor) -> Tensor:
    """The parabola through three rows, ``late`` rows after the middle one."""
    return at + late * (0.5 * (on - back) + 0.5 * late * (on - 2 * at + back))
