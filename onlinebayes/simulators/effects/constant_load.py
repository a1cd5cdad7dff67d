"""A constant force at a joint, either sign: tau = L."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from jaxtyping import Float
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.bounds import joint_unit
from onlinebayes.simulators.effects.scales import Scales
from onlinebayes.simulators.effects.seen import Seen


@dataclass(frozen=True)
class ConstantLoad(Effect):
    """A constant force L on a slide or hinge joint.

    Args:
        target: joint.
        load: bounds of L [N, N m].
    """

    target: str
    load: Parameter
    name = "constant_load"
    target_kind = "joint"

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """L up to the largest force in play, either sign."""
        return cls(target, Parameter(-scales.force, scales.force, joint_unit(scales.unit, "N", "N m")))

    @property
    def parameters(self) -> ParameterSpace:
        """``load``."""
        return ParameterSpace({"load": self.load})

    @property
    def neutral(self) -> Mapping[str, float]:
        """L = 0."""
        return {"load": 0.0}

    def force(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """L [N, N m]."""
        return parameters["load"]
