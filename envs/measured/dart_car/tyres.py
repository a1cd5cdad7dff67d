"""Correction of a linear tyre: its side force saturates.

    F = W c alpha / (1 + s |alpha|)         at s = 0 the linear tyre, for large slip angles W c / s

alpha slip angle [rad], W load of the axle [N], c cornering coefficient [1/rad]. The rational law is the simplest with
one parameter more; Pacejka's magic formula has four (H. B. Pacejka, "Tire and Vehicle Dynamics", 3rd ed., ch. 4).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import Effect, Scales


@dataclass(frozen=True)
class TyreSaturation(Effect):
    """The side force of an axle bends over as its slip angle grows.

    Args:
        target: axle, ``"front"`` or ``"rear"``.
        curvature: bounds of s >= 0 [1/rad].
    """

    target: str
    curvature: Parameter
    name = "tyre_saturation"
    target_kind = "body"

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """s up to half of the linear force lost at a twentieth of a radian."""
        return cls(target, Parameter(0.0, 20.0, "1/rad"))

    @property
    def parameters(self) -> ParameterSpace:
        """``curvature``."""
        return ParameterSpace({"curvature": self.curvature})

    @property
    def neutral(self) -> Mapping[str, float]:
        """s = 0."""
        return {"curvature": 0.0}

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """A tyre that has lost half at 0.2 rad: what saturates is not small-signal linear."""
        return ({"curvature": self.curvature.low + 0.25 * (self.curvature.high - self.curvature.low)},)
