"""Parameters that change in time: what each window is replayed with.

    theta_w = clip(theta + sum of shifts(begin_w, end_w)),      clip to the parameters' bounds

Within a window a parameter is constant; it takes the mean over the window (``Effect.shift``). Instants are those of
the measurements' time column.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.windows import Windows
from onlinebayes.simulators.base import Simulator


def in_time(simulator: Simulator, windows: Windows, theta: Float[Tensor, "M W P"]) -> Float[Tensor, "M W P"]:
    """Theta of every window with what changes in time; the same tensor where nothing does.

    Args:
        simulator: the physics, whose effects on parameters act here.
        windows: W windows of one length.
        theta: of every window without these effects [SI].
    """
    shifts: dict[int, Tensor] = {}
    begin, end = instants(windows)
    space = simulator.parameters
    for effect in simulator.effects:
        own = {name: theta[..., space.index(f"{effect.key}.{name}")] for name in effect.parameters}
        shift = effect.shift(own, begin.to(theta), end.to(theta)) if effect.target_kind == "parameter" else None
        if shift is not None:
            i = space.index(effect.target)
            shifts[i] = shifts[i] + shift if i in shifts else shift
    if not shifts:
        return theta
    columns = list(theta.unbind(-1))
    for i, shift in shifts.items():
        columns[i] = (columns[i] + shift).clamp(float(space.low[i]), float(space.high[i]))
    return torch.stack(columns, dim=-1)


def instants(windows: Windows) -> tuple[Float[Tensor, " W"], Float[Tensor, " W"]]:
    """When each window begins and ends, on the measurements' clock [s]."""
    begin = torch.tensor(windows.begin, dtype=torch.float64)[windows.run] + windows.step * windows.first
    return begin, begin + windows.horizon
