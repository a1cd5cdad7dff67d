"""Two effects that no motion of a slide tells apart from others: a back-EMF, and a rotor's inertia."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import Effect, Scales


@dataclass(frozen=True)
class BackEmf(Effect):
    """-k v on a joint: viscous friction by another name."""

    target: str
    constant: Parameter
    name = "back_emf"
    target_kind = "joint"
    fields = ("dof_damping",)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        return cls(target, Parameter(0.0, scales.force / scales.speed, ""))

    @property
    def parameters(self) -> ParameterSpace:
        return ParameterSpace({"constant": self.constant})

    @property
    def neutral(self) -> Mapping[str, float]:
        return {"constant": 0.0}

    def write(
        self, model: mujoco.MjModel, fields: Mapping[str, np.ndarray], parameters: Mapping[str, np.ndarray]
    ) -> None:
        fields["dof_damping"][:, int(model.joint(self.target).dofadr[0])] += parameters["constant"]


@dataclass(frozen=True)
class Armature(Effect):
    """A rotor's inertia; on a mass that nothing else acts on the same as a weaker motor."""

    target: str
    armature: Parameter
    name = "armature"
    target_kind = "joint"
    fields = ("dof_armature",)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        return cls(target, Parameter(0.0, 1.0, "kg"))

    @property
    def parameters(self) -> ParameterSpace:
        return ParameterSpace({"armature": self.armature})

    @property
    def neutral(self) -> Mapping[str, float]:
        return {"armature": 0.0}

    def write(
        self, model: mujoco.MjModel, fields: Mapping[str, np.ndarray], parameters: Mapping[str, np.ndarray]
    ) -> None:
        fields["dof_armature"][:, int(model.joint(self.target).dofadr[0])] += parameters["armature"]
