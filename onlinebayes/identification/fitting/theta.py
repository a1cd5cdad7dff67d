"""Theta by name and as a vector, and how far it may move within its bounds."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.scope import address_of
from onlinebayes.simulators.base import Simulator


def theta_of(simulator: Simulator, values: Mapping[str, float]) -> Float[Tensor, " P"]:
    """Known values by name, nominal ones for all other parameters, within the bounds [SI].

    A run's own value that is not known is the one for all, and one for all is the mean of the runs' own.
    """
    own: dict[str, list[float]] = {}
    for name, value in values.items():
        own.setdefault(address_of(name), []).append(value)
    theta = simulator.nominal.clone().to(torch.float64)
    for i, name in enumerate(simulator.parameters):
        if name in values:
            theta[i] = values[name]
        elif known := own.get(address_of(name)):
            theta[i] = sum(known) / len(known)
    return simulator.parameters.clamp(theta)


def values_of(simulator: Simulator, theta: Float[Tensor, " P"]) -> dict[str, float]:
    """Theta by name [SI]."""
    return dict(zip(simulator.parameters.names, theta.tolist(), strict=True))


def room(simulator: Simulator, theta: Float[Tensor, " P"]) -> tuple[Float[Tensor, " P"], Float[Tensor, " P"]]:
    """Return the largest steps of theta down and up within the simulator's bounds [SI]."""
    return simulator.parameters.low.to(theta) - theta, simulator.parameters.high.to(theta) - theta
