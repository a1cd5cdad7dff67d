"""What may be wrong with a model: a hypothesis is the base model with some additions, as a value that can be compared.

A hypothesis holds no fitted value. :func:`build` makes the simulator that it stands for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.hypotheses.additions import Addition
from onlinebayes.identification.replaying.scoped import ScopedSimulator
from onlinebayes.identification.scope import address_of
from onlinebayes.simulators.identifiable import Identifiable


@dataclass(frozen=True)
class Hypothesis:
    """Additions to the base model, in the order in which they entered."""

    additions: tuple[Addition, ...] = ()

    @property
    def keys(self) -> tuple[str, ...]:
        """Of the additions."""
        return tuple(addition.key for addition in self.additions)

    def plus(self, addition: Addition) -> Hypothesis:
        """With one addition more."""
        return Hypothesis((*self.additions, addition))

    def minus(self, key: str) -> Hypothesis:
        """Without one of its additions."""
        return Hypothesis(tuple(addition for addition in self.additions if addition.key != key))

    def __str__(self) -> str:
        return " + ".join(self.keys) or "the model as it is"


def build(base: Identifiable, hypothesis: Hypothesis, runs: Sequence[str]) -> Identifiable:
    """The simulator of a hypothesis.

    Args:
        base: the model as the user gave it.
        hypothesis: what is added.
        runs: names of the fit runs, each of which gets own values where some differ by run.

    Raises:
        BadInput: the simulator cannot carry one of the additions.
    """
    simulator = ScopedSimulator(base.physics, base.scope, runs) if isinstance(base, ScopedSimulator) else base
    for addition in hypothesis.additions:
        simulator = addition.joined(simulator, runs)
    return simulator


def theta_of(simulator: Identifiable, values: Mapping[str, float]) -> Float[Tensor, " P"]:
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


def values_of(simulator: Identifiable, theta: Float[Tensor, " P"]) -> dict[str, float]:
    """Theta by name [SI]."""
    return dict(zip(simulator.parameters.names, theta.tolist(), strict=True))


def room(simulator: Identifiable, theta: Float[Tensor, " P"]) -> tuple[Float[Tensor, " P"], Float[Tensor, " P"]]:
    """How far theta may go down and up within the simulator's bounds [SI]."""
    return simulator.parameters.low.to(theta) - theta, simulator.parameters.high.to(theta) - theta
