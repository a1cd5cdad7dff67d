"""The other parameters that would be true if an effect had a given size, as the present data then put them.

    theta* = argmin over theta of |r~(theta, k)|^2,     k held

An effect that a parameter mimics in the present data is no surprise to the model without it: that parameter was fitted
with the effect in it. Left at the value of that fit, it would be taken for a contradiction.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.gauss_newton import Fitted
from onlinebayes.identification.fitting.rows import project, start_shift
from onlinebayes.identification.fitting.sensitivities import linearise
from onlinebayes.identification.fitting.theta import room
from onlinebayes.identification.replaying.bounded import bounded_least_squares
from onlinebayes.simulators.identifiable import Identifiable

ROUNDS = 4


def adapted(
    simulator: Identifiable, windows: Windows, theta: Float[Tensor, " P"], free: Bool[Tensor, " P"], fitted: Fitted
) -> Float[Tensor, " P"]:
    """Theta some of whose entries suit the present data while the others stay; as given where the replay diverges.

    Args:
        simulator: with the effect.
        windows: of the present data.
        theta: where to begin [SI].
        free: the entries that adapt.
        fitted: the model without the effect: its starts and weights.
    """
    best, least, starts = theta, torch.inf, fitted.lin.starts
    for _ in range(ROUNDS):
        lin = linearise(simulator, windows, theta, starts)
        rows = project(windows, lin, fitted.rows.weight)
        if not lin.valid or rows.objective >= least:
            break
        best, least = theta, rows.objective
        C, r = rows.columns.flatten(0, 1)[:, free], rows.residual.flatten()
        low, high = (end[free] for end in room(simulator, theta))
        step = torch.zeros_like(theta)
        step[free] = bounded_least_squares(C.T @ C, C.T @ r, low, high)
        starts = starts + start_shift(windows, lin, rows, step[None])[0]
        theta = theta + step
    return best
