"""The hidden parameters of an experiment, one point of their space for each seed."""

from __future__ import annotations

import torch
from jaxtyping import Float
from scipy.stats import qmc
from torch import Tensor

from onlinebayes.parameters import ParameterSpace


def hidden_truth(space: ParameterSpace, seed: int, default: dict[str, float]) -> Float[Tensor, " P"]:
    """Seed 0: the default values. Seed s: point s + 1 of the unscrambled Sobol sequence over the bounds.

    Points 0 and 1 are left out: a corner of the bounds, and their centre, which whoever guesses the prior's mean knows.

    Args:
        space: of the parameters.
        seed: 0 or more.
        default: each parameter's value at seed 0, in its own unit.

    Returns:
        theta, shape (P,), in the order of the space.
    """
    if seed == 0:
        return space.vector(default)
    point = qmc.Sobol(d=len(space), scramble=False).fast_forward(seed + 1).random(1)[0]
    return space.from_unit(torch.from_numpy(point))
