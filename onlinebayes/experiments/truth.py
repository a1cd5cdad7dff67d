"""The hidden parameters of an experiment, one point of their space for each seed, or chosen by hand."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from scipy.stats import qmc
from torch import Tensor

from onlinebayes.experiments.assignments import assignments
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput, nearest


def hidden_truth(
    space: ParameterSpace, seed: int, default: dict[str, float], chosen: Sequence[str] = ()
) -> Float[Tensor, " P"]:
    """Seed 0: the default values. Seed s: point s + 1 of the unscrambled Sobol sequence over the bounds.

    Points 0 and 1 are left out: a corner of the bounds, and their centre, which whoever guesses the prior's mean knows.

    Args:
        space: of the parameters.
        seed: 0 or more.
        default: each parameter's value at seed 0, in its own unit.
        chosen: each ``NAME=VALUE`` [the parameter's unit], in the place of the seed's value.

    Returns:
        theta, shape (P,), in the order of the space.

    Raises:
        BadInput: a chosen name that the space lacks, or a value outside its bounds.
    """
    if seed == 0:
        theta = space.vector(default)
    else:
        point = qmc.Sobol(d=len(space), scramble=False).fast_forward(seed + 1).random(1)[0]
        theta = space.from_unit(torch.from_numpy(point))
    values = chosen_values(space, chosen)
    return space.vector({**dict(zip(space.names, theta.tolist(), strict=True)), **values}) if values else theta


def chosen_values(space: ParameterSpace, chosen: Sequence[str]) -> dict[str, float]:
    """Values of parameters out of ``NAME=VALUE``; errors as :func:`hidden_truth`."""
    found = {}
    for name, text in assignments(chosen, "truth").items():
        if name not in space:
            raise BadInput(f"the hidden system has no parameter {name!r}", nearest(name, space.names))
        parameter = space[name]
        try:
            found[name] = float(text)
        except ValueError:
            raise BadInput(f"--truth {name}={text}", "give a number") from None
        if not parameter.low <= found[name] <= parameter.high:
            raise BadInput(
                f"--truth {name}={text} is outside of the prior's bounds",
                f"give a value from {parameter.low:g} to {parameter.high:g} {parameter.unit}".rstrip(),
            )
    return found
