"""Rotor inertia at a joint: (M + J e e^T) a = f + tau.

e is the joint's unit vector in generalised coordinates. A rotor behind a gear of ratio n counts n^2 times. On a single
joint whose own mass is free, it is that mass: the data leave the two open.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.bounds import joint_unit, non_negative, starts_within
from onlinebayes.simulators.effects.scales import Scales

LARGEST = 30.0
"""Times the inertia that the joint moves: a rotor behind a gear may have many times that of the limb."""


@dataclass(frozen=True)
class Armature(Effect):
    """Rotor inertia J of a slide or hinge joint; it adds to the armature that the model has.

    A torch system gives accelerations and not its mass matrix: it has no form there.

    Args:
        target: joint.
        armature: bounds of J >= 0 [kg, kg m2].
    """

    target: str
    armature: Parameter
    name = "armature"
    target_kind = "joint"
    same_law_as = ("joint.*.armature",)

    def __post_init__(self) -> None:
        non_negative(self.key, "armature", self.armature)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """J up to :data:`LARGEST` times the inertia that the joint moves."""
        return cls(target, Parameter(0.0, LARGEST * scales.inertia, joint_unit(scales.unit, "kg", "kg m2")))

    @property
    def parameters(self) -> ParameterSpace:
        """``armature``."""
        return ParameterSpace({"armature": self.armature})

    @property
    def neutral(self) -> Mapping[str, float]:
        """J = 0."""
        return {"armature": 0.0}

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """Also from about once and ten times that inertia: the accelerations fall off as 1 / (I + J)."""
        return starts_within("armature", self.armature, (1 / LARGEST, 1 / 3))
