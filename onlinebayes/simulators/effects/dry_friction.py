"""Dry (Coulomb) friction of a joint: -F sign(v) in motion, up to F at rest."""

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
class DryFriction(Effect):
    """Coulomb friction on a slide or hinge joint; it adds to the frictionloss that the model has.

    Args:
        target: joint.
        frictionloss: bounds of F >= 0 [N, N m].
    """

    target: str
    frictionloss: Parameter
    name = "dry_friction"
    target_kind = "joint"
    same_law_as = ("joint.*.frictionloss",)

    def __post_init__(self) -> None:
        non_negative(self.key, "frictionloss", self.frictionloss)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """F up to the largest force in play."""
        return cls(target, Parameter(0.0, scales.force, joint_unit(scales.unit, "N", "N m")))

    @property
    def parameters(self) -> ParameterSpace:
        """``frictionloss``."""
        return ParameterSpace({"frictionloss": self.frictionloss})

    @property
    def neutral(self) -> Mapping[str, float]:
        """F = 0."""
        return {"frictionloss": 0.0}

    def friction_bound(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """F [N, N m]."""
        return parameters["frictionloss"]
