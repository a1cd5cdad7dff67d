"""Dry friction that grows with the square of the load on the drive: up to nu f^2, f the actuators' force at the joint.

Beside :mod:`.load_dependent_friction`, to which it adds, it is the next term of a friction that rises ever faster with
the torque in the gears (the quadratic term of Duclusaud, Passault, Padois and Ly 2025, with the drive's torque alone).
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
from onlinebayes.simulators.standalone.frictions import SquaredLoad


@dataclass(frozen=True)
class QuadraticLoadFriction(Effect):
    """Dry friction of size nu f^2 on a slide or hinge joint.

    Args:
        target: joint.
        nu: bounds of nu >= 0 [1/N, 1/(N m)].
    """

    target: str
    nu: Parameter
    name = "quadratic_load_friction"
    target_kind = "joint"
    needs_drive = True
    tried_at_servos = True  # behind a motor its recordings seldom part it from load_dependent_friction

    def __post_init__(self) -> None:
        non_negative(self.key, "nu", self.nu)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """nu up to where the largest force in play locks the drive."""
        return cls(target, Parameter(0.0, 1.0 / scales.force, joint_unit(scales.unit, "1/N", "1/(N m)")))

    @property
    def parameters(self) -> ParameterSpace:
        """``nu``."""
        return ParameterSpace({"nu": self.nu})

    @property
    def neutral(self) -> Mapping[str, float]:
        """nu = 0."""
        return {"nu": 0.0}

    def standalone(self, values: Mapping[str, float]) -> SquaredLoad:
        """See :class:`.SquaredLoad`."""
        return SquaredLoad(values["nu"])

    def friction_bound(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """nu f^2 [N, N m]."""
        return parameters["nu"] * seen.drive.square()
