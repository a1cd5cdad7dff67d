"""Viscous friction of a joint: tau = -d v."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from jaxtyping import Float
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.bounds import joint_unit, non_negative
from onlinebayes.simulators.effects.scales import Scales
from onlinebayes.simulators.effects.seen import Seen


@dataclass(frozen=True)
class ViscousFriction(Effect):
    """-d v on a slide or hinge joint; it adds to the damping that the model has.

    Args:
        target: joint.
        damping: bounds of d >= 0 [N s/m, N m s/rad].
    """

    target: str
    damping: Parameter
    name = "viscous_friction"
    target_kind = "joint"
    same_law_as = ("joint.*.damping",)

    def __post_init__(self) -> None:
        non_negative(self.key, "damping", self.damping)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """d up to the value that brakes with the largest force at the largest speed."""
        unit = joint_unit(scales.unit, "N s/m", "N m s/rad")
        return cls(target, Parameter(0.0, scales.force / scales.speed, unit))

    @property
    def parameters(self) -> ParameterSpace:
        """``damping``."""
        return ParameterSpace({"damping": self.damping})

    @property
    def neutral(self) -> Mapping[str, float]:
        """d = 0."""
        return {"damping": 0.0}

    def force(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """-d v [N, N m]."""
        return -parameters["damping"] * seen.v
