"""A point mass at a body's own centre of mass: m -> m + dm, the centre and the inertia about it stay.

Carried by MuJoCo as ``body_mass``. Where the body's mass is free already, it is that mass.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects.base import Effect, Scales
from onlinebayes.simulators.effects.bounds import non_negative


@dataclass(frozen=True)
class Payload(Effect):
    """A point mass dm carried at a body's centre of mass.

    Args:
        target: body that a joint moves.
        mass: bounds of dm >= 0 [kg].
    """

    target: str
    mass: Parameter
    name = "payload"
    target_kind = "body"
    fields = ("body_mass",)

    def __post_init__(self) -> None:
        non_negative(self.key, "mass", self.mass)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """dm up to twice the body's own mass."""
        return cls(target, Parameter(0.0, 2 * scales.inertia, "kg"))

    @property
    def parameters(self) -> ParameterSpace:
        """``mass``."""
        return ParameterSpace({"mass": self.mass})

    @property
    def neutral(self) -> Mapping[str, float]:
        """dm = 0."""
        return {"mass": 0.0}

    def write(
        self, model: mujoco.MjModel, fields: Mapping[str, np.ndarray], parameters: Mapping[str, np.ndarray]
    ) -> None:
        """``body_mass += dm``."""
        fields["body_mass"][:, int(model.body(self.target).id)] += parameters["mass"]
