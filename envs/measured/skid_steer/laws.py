"""Effects of a real skid-steered vehicle beside two tracks that roll as they are told.

    turning_slip       w = w_k / (1 + s |w_k|)                     w_k the kinematic yaw rate [rad/s]
    side_asymmetry     the left wheels roll r (1 - a), the right ones r (1 + a)

A skid-steered vehicle turns by dragging its wheels sideways; the faster it turns, the more of their speed is lost. The
constant part of that loss is the effective track. After A. Mandow, J. L. Martinez, J. Morales, J. L. Blanco,
A. Garcia-Cerezo and J. Gonzalez, "Experimental kinematics for wheeled skid-steer mobile robots", IROS 2007.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import Effect, Scales


@dataclass(frozen=True)
class TurningSlip(Effect):
    """The yaw rate falls short of the kinematic one by 1 / (1 + s |w|).

    Args:
        target: the vehicle.
        slip: bounds of s >= 0 [s/rad].
    """

    target: str
    slip: Parameter
    name = "turning_slip"
    target_kind = "body"

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """s up to half of the turning lost at 1 rad/s."""
        return cls(target, Parameter(0.0, 1.0, "s/rad"))

    @property
    def parameters(self) -> ParameterSpace:
        """``slip``."""
        return ParameterSpace({"slip": self.slip})

    @property
    def neutral(self) -> Mapping[str, float]:
        """s = 0."""
        return {"slip": 0.0}


@dataclass(frozen=True)
class SideAsymmetry(Effect):
    """The right wheels roll further than the left ones.

    Args:
        target: the vehicle.
        asymmetry: bounds of a, either sign [1].
    """

    target: str
    asymmetry: Parameter
    name = "side_asymmetry"
    target_kind = "body"

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """a up to a third, either sign."""
        return cls(target, Parameter(-0.33, 0.33, "1"))

    @property
    def parameters(self) -> ParameterSpace:
        """``asymmetry``."""
        return ParameterSpace({"asymmetry": self.asymmetry})

    @property
    def neutral(self) -> Mapping[str, float]:
        """a = 0."""
        return {"asymmetry": 0.0}
