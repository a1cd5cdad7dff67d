"""Parameters that change in time: what each piece of a window is replayed with.

    theta_wp = clip(theta + sum of shifts(begin_wp, end_wp)),      clip to the parameters' bounds
    lag_w = offset + rate (begin_w - t0)                           of a sensor whose clock drifts

Within a piece, an eighth of a window, a parameter is constant and takes the mean over it (``Effect.shift``). Held for
whole windows, a fast drift leaves more than noise. A sensor's clock is told by how much it lags at a window's start,
and drifts on within it by itself. Instants are those of the measurements' time column.
"""

from __future__ import annotations

from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.simulators.abilities import Measured

PIECES_OF_A_WINDOW = 8

Rows = tuple[int, int]
"""From and to which of a window's rows."""


def pieces(simulator: Measured, windows: Windows) -> list[Rows]:
    """The rows of each piece; all as one where nothing changes in time."""
    changes = any(effect.target_kind == "parameter" for effect in simulator.effects)
    edges = torch.linspace(0, windows.rows, PIECES_OF_A_WINDOW + 1 if changes else 2).round().long().tolist()
    return [(first, last) for first, last in pairwise(edges) if last > first]


def in_time(
    simulator: Measured, windows: Windows, theta: Float[Tensor, "M W P"], rows: Rows | None = None
) -> Float[Tensor, "M W P"]:
    """Theta of every window with what changes in time; the same tensor where nothing does.

    Args:
        simulator: the physics, whose effects that shift a parameter act here.
        windows: W windows of one length.
        theta: of every window without these effects [SI].
        rows: of a piece; the mean over all when None.
    """
    acting = [effect for effect in simulator.effects if effect.shifted]
    if not acting:
        return theta
    columns, held = list(theta.unbind(-1)), set[int]()
    begin, end = (instant.to(theta) for instant in instants(windows, rows))
    space = simulator.parameters
    for effect in acting:
        own = {name: theta[..., space.index(f"{effect.key}.{name}")] for name in effect.parameters}
        shift = effect.shift(own, begin, end)
        if shift is not None:
            i = space.index(effect.shifted)
            columns[i] = columns[i] + shift
            held |= {i} if effect.target_kind == "parameter" else set()  # a lag outgrows what it begins with
    for i in held:
        columns[i] = columns[i].clamp(float(space.low[i]), float(space.high[i]))
    return torch.stack(columns, dim=-1)


def instants(windows: Windows, rows: Rows | None = None) -> tuple[Float[Tensor, " W"], Float[Tensor, " W"]]:
    """When each window, or a piece of it, begins and ends, on the measurements' clock [s]."""
    began = torch.tensor(windows.begin, dtype=torch.float64, device=windows.run.device)
    begin = began[windows.run] + windows.step * windows.first
    first, last = rows or (0, windows.rows)
    return begin + windows.step * first, begin + windows.step * last
