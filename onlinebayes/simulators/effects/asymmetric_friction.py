"""Dry friction that differs by direction: -F+ for v > 0, +F- for v < 0, in between whatever holds the joint at rest.

It is exactly dry friction of size F and a constant force L together,

    v > 0:  L - F = -F+        F = (F+ + F-) / 2
    v < 0:  L + F = +F-        L = (F- - F+) / 2

and at rest both hold a load tau with -F- <= tau <= F+. A constant load beside dry friction can therefore not be told
from it.
"""

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
class AsymmetricFriction(Effect):
    """Coulomb friction of two sizes, one for each direction, on a slide or hinge joint.

    Args:
        target: joint.
        frictionloss_positive: bounds of F+ >= 0, the friction while v > 0 [N, N m].
        frictionloss_negative: bounds of F- >= 0, the friction while v < 0 [N, N m].
    """

    target: str
    frictionloss_positive: Parameter
    frictionloss_negative: Parameter
    name = "asymmetric_friction"
    target_kind = "joint"
    contains = ("dry_friction",)
    sum_of = ("dry_friction", "constant_load")

    def __post_init__(self) -> None:
        non_negative(self.key, "frictionloss_positive", self.frictionloss_positive)
        non_negative(self.key, "frictionloss_negative", self.frictionloss_negative)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """Both up to the largest force in play."""
        bounds = Parameter(0.0, scales.force, joint_unit(scales.unit, "N", "N m"))
        return cls(target, bounds, bounds)

    @property
    def parameters(self) -> ParameterSpace:
        """``frictionloss_positive`` and ``frictionloss_negative``."""
        return ParameterSpace(
            {
                "frictionloss_positive": self.frictionloss_positive,
                "frictionloss_negative": self.frictionloss_negative,
            }
        )

    @property
    def neutral(self) -> Mapping[str, float]:
        """F+ = F- = 0."""
        return {"frictionloss_positive": 0.0, "frictionloss_negative": 0.0}

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """Weak friction, stronger in either direction."""

        def at(plus: float, minus: float) -> dict[str, float]:
            pairs = zip(self.parameters.items(), (plus, minus), strict=True)
            return {name: bounds.low + part * (bounds.high - bounds.low) for (name, bounds), part in pairs}

        return (at(0.05, 0.1), at(0.1, 0.05))

    def force(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """L [N, N m]."""
        return (parameters["frictionloss_negative"] - parameters["frictionloss_positive"]) / 2

    def friction_bound(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """F [N, N m]."""
        return (parameters["frictionloss_negative"] + parameters["frictionloss_positive"]) / 2
