"""Gravity turned from where the model has it: by an angle, towards a horizontal direction.

    g' = g cos a + (n x g) sin a + n (n . g) (1 - cos a),    n = (sin d, -cos d, 0)        (Rodrigues)

For g = (0, 0, -G): g' = G (sin a cos d, sin a sin d, -cos a), downhill towards d, counted from x to y. At a = 0 the
direction means nothing, so that ``gravity_tilt@world`` (a >= 0 and d) has no small-signal form; the targets ``world.x``
and ``world.y`` tilt along one axis by a signed angle, and criticism tries these. On slides alone a tilt is a constant
force (:mod:`.constant_load`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from jaxtyping import Float

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects.base import Effect, split_axis
from onlinebayes.simulators.effects.bounds import non_negative
from onlinebayes.simulators.effects.scales import Scales

AXES = ("x", "y")
LARGEST = 0.5
"""The largest tilt that ``diagnose`` tries, more than any table stands askew [rad]."""


@dataclass(frozen=True)
class GravityTilt(Effect):
    """Gravity turned from the vertical.

    Args:
        target: ``"world"``, or ``"world.x"`` and ``"world.y"`` for a tilt along one axis.
        angle: bounds of a [rad]; never negative where the direction is a parameter too.
        direction: bounds of d [rad], None for a tilt along one axis.
    """

    target: str
    angle: Parameter
    direction: Parameter | None = None
    name = "gravity_tilt"
    target_kind = "world"
    axes = AXES

    def __post_init__(self) -> None:
        if (self.direction is None) != bool(split_axis(self.target, AXES)[1]):
            raise BadInput(f"{self.key}.direction does not fit the target", "give it for @world, not for one axis")
        if self.direction is not None:
            non_negative(self.key, "angle", self.angle)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """Up to half a radian; along one axis either way."""
        if split_axis(target, AXES)[1]:
            return cls(target, Parameter(-LARGEST, LARGEST, "rad"))
        return cls(target, Parameter(0.0, LARGEST, "rad"), Parameter(-math.pi, math.pi, "rad"))

    @property
    def parameters(self) -> ParameterSpace:
        """``angle``, and ``direction`` for a tilt that has one."""
        own = {"angle": self.angle}
        return ParameterSpace(own if self.direction is None else {**own, "direction": self.direction})

    @property
    def neutral(self) -> Mapping[str, float]:
        """a = 0; the direction, without meaning then, is the middle of its bounds."""
        if self.direction is None:
            return {"angle": 0.0}
        return {"angle": 0.0, "direction": (self.direction.low + self.direction.high) / 2}

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """A small tilt towards four directions, where the direction is a parameter."""
        if self.direction is None:
            return ()
        low, high = self.direction.low, self.direction.high
        a = self.angle.low + 0.1 * (self.angle.high - self.angle.low)
        return tuple({"angle": a, "direction": low + part * (high - low)} for part in (0.0, 0.25, 0.5, 0.75))

    def said_by_joints(self, kinds: Mapping[str, str], moving: Sequence[str]) -> bool:
        """Check whether all joints are slides: the tilt is then a constant load of each."""
        return all(kind == "slide" for kind in kinds.values())

    @property
    def element(self) -> str:
        """``"world"``."""
        return split_axis(self.target, AXES)[0]

    def turned(
        self, gravity: Float[np.ndarray, "N 3"], parameters: Mapping[str, np.ndarray]
    ) -> Float[np.ndarray, "N 3"]:
        """g', in worlds with a tilt [m/s2].

        Args:
            gravity: g [m/s2].
            parameters: short name -> values (N,) [rad].
        """
        angle = parameters["angle"]
        along = 0.5 * math.pi * AXES.index(split_axis(self.target, AXES)[1] or "x")
        direction = parameters.get("direction", np.full_like(angle, along))
        n = np.stack([np.sin(direction), -np.cos(direction), np.zeros_like(direction)], axis=-1)
        g, a = gravity, angle[:, None]
        turned = g * np.cos(a) + np.cross(n, g) * np.sin(a) + n * (n * g).sum(1, keepdims=True) * (1 - np.cos(a))
        return np.where(a != 0, turned, g)
