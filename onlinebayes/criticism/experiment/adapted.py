"""What else would be true if an effect had a given size: the other parameters, as the present data then put them.

    theta* = argmin over theta of |r~(theta, k)|^2,     k held

An effect that a parameter mimics in the present data is no surprise to the model without it: that parameter was fitted
with the effect in it. Left at the value of that fit, it would be taken for a contradiction.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.projection import project, start_shift
from onlinebayes.identification.fitting.sensitivities import linearise
from onlinebayes.identification.replaying.bounded import bounded_least_squares
from onlinebayes.simulators.identifiable import Identifiable

ROUNDS = 4


def adapted(
    simulator: Identifiable,
    windows: Windows,
    theta: Float[Tensor, " P"],
    free: int,
    starts: Float[Tensor, "W J2"],
    weight: Float[Tensor, " S"],
) -> Float[Tensor, " P"]:
    """Theta whose first entries suit the present data while the others stay; as given where the replay diverges.

    Args:
        simulator: with the effect, whose parameters come last.
        windows: of the present data.
        theta: where to begin [SI].
        free: number of the entries that adapt.
        starts: of the windows, where to begin.
        weight: of each signal.
    """
    low, high = simulator.parameters.low.to(theta)[:free], simulator.parameters.high.to(theta)[:free]
    best, least = theta, torch.inf
    for _ in range(ROUNDS):
        lin = linearise(simulator, windows, theta, starts)
        projected = project(windows, lin, weight)
        if not lin.valid or projected.objective >= least:
            break
        best, least = theta, projected.objective
        C, r = projected.columns.flatten(0, 1)[:, :free], projected.residual.flatten()
        moved = bounded_least_squares(C.T @ C, C.T @ r, low - theta[:free], high - theta[:free])
        step = torch.cat([moved, theta.new_zeros(len(theta) - free)])
        starts = starts + start_shift(windows, lin, projected, step)
        theta = theta + step
    return best
