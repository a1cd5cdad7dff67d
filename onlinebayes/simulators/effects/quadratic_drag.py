"""Quadratic drag of a joint: tau = -k v abs(v)."""

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
class QuadraticDrag(Effect):
    """-k v abs(v) on a slide or hinge joint; it adds to the polynomial damping that the model has.

    Args:
        target: joint.
        drag: bounds of k >= 0 [N s2/m2, N m s2/rad2].
    """

    target: str
    drag: Parameter
    name = "quadratic_drag"
    target_kind = "joint"

    def __post_init__(self) -> None:
        non_negative(self.key, "drag", self.drag)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """k up to the value that brakes with the largest force at the largest speed."""
        unit = joint_unit(scales.unit, "N s2/m2", "N m s2/rad2")
        return cls(target, Parameter(0.0, scales.force / scales.speed**2, unit))

    @property
    def parameters(self) -> ParameterSpace:
        """``drag``."""
        return ParameterSpace({"drag": self.drag})

    @property
    def neutral(self) -> Mapping[str, float]:
        """k = 0."""
        return {"drag": 0.0}

    def force(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """-k v abs(v) [N, N m]."""
        return -parameters["drag"] * seen.v * seen.v.abs()
