"""Dry friction that grows with the load on the drive: up to mu abs(f), f the actuators' generalised force at the joint.

The friction of gears and screws, whose teeth are pressed together by the torque that they pass on. f is that of the
model's own actuators on the joint, with what effects at them add; the friction sticks, as other dry friction does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from jaxtyping import Float
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.bounds import non_negative
from onlinebayes.simulators.effects.scales import Scales
from onlinebayes.simulators.effects.seen import Seen
from onlinebayes.simulators.standalone.frictions import LoadFriction


@dataclass(frozen=True)
class LoadDependentFriction(Effect):
    """Dry friction of size mu abs(f) on a slide or hinge joint.

    Args:
        target: joint.
        mu: bounds of mu >= 0 [1].
    """

    target: str
    mu: Parameter
    name = "load_dependent_friction"
    target_kind = "joint"
    needs_drive = True

    def __post_init__(self) -> None:
        non_negative(self.key, "mu", self.mu)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """mu up to 1, where the drive locks itself."""
        return cls(target, Parameter(0.0, 1.0, ""))

    @property
    def parameters(self) -> ParameterSpace:
        """``mu``."""
        return ParameterSpace({"mu": self.mu})

    @property
    def neutral(self) -> Mapping[str, float]:
        """mu = 0."""
        return {"mu": 0.0}

    def standalone(self, values: Mapping[str, float]) -> LoadFriction:
        """See :class:`.LoadFriction`."""
        return LoadFriction(values["mu"])

    def friction_bound(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """mu abs(f) [N, N m]."""
        return parameters["mu"] * seen.drive.abs()
