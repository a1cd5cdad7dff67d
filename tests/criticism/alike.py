"""Two effects that no motion of a slide tells apart from others: a back-EMF, and a rotor's inertia."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import Effect, Scales
from onlinebayes.simulators.mujoco import NATIVE, JointField


@dataclass(frozen=True)
class BackEmf(Effect):
    """-k v on a joint: viscous friction by another name."""

    target: str
    constant: Parameter
    name = "back_emf"
    target_kind = "joint"

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        return cls(target, Parameter(0.0, scales.force / scales.speed, ""))

    @property
    def parameters(self) -> ParameterSpace:
        return ParameterSpace({"constant": self.constant})

    @property
    def neutral(self) -> Mapping[str, float]:
        return {"constant": 0.0}


@dataclass(frozen=True)
class Armature(Effect):
    """A rotor's inertia; on a mass that nothing else acts on the same as a weaker motor."""

    target: str
    armature: Parameter
    name = "armature"
    target_kind = "joint"

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        return cls(target, Parameter(0.0, 1.0, "kg"))

    @property
    def parameters(self) -> ParameterSpace:
        return ParameterSpace({"armature": self.armature})

    @property
    def neutral(self) -> Mapping[str, float]:
        return {"armature": 0.0}


NATIVE |= {BackEmf: JointField(("dof_damping",)), Armature: JointField(("dof_armature",))}
