"""Drag in a steady horizontal wind: f = -c abs(v - w) (v - w) at a body's centre of mass.

The effect brings the drag c that the wind needs to act; where bodies have an :mod:`.air_drag` too, the same wind blows
on it, and the two drags add up. At c = 0 and w = 0 it is nothing, at w = 0 it is air drag. ``wind@body.x`` and
``wind@body.y`` blow along one axis, ``wind@body`` along both. A body that is slow against the wind feels little more
than a constant force c abs(w) w, which determines c and w only together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects.air_drag import largest_drag
from onlinebayes.simulators.effects.base import Effect, split_axis
from onlinebayes.simulators.effects.bounds import non_negative
from onlinebayes.simulators.effects.scales import Scales

AXES = ("x", "y")
STRONGEST = 15.0
"""The strongest wind that ``diagnose`` tries, a near gale [m/s]."""


@dataclass(frozen=True)
class Wind(Effect):
    """A steady horizontal wind, and the drag by which it acts on a body or on all.

    Args:
        target: body that a joint moves, or ``"world"``; with ``.x`` or ``.y`` for a wind along one axis of the world.
        drag: bounds of c >= 0 [N s2/m2]; for the world as for air drag.
        velocity: bounds of w along the target's axis [m/s]; None without an axis.
        velocity_x, velocity_y: bounds of w [m/s]; None for a target with an axis.
    """

    target: str
    drag: Parameter
    velocity: Parameter | None = None
    velocity_x: Parameter | None = None
    velocity_y: Parameter | None = None
    name = "wind"
    target_kind = "body"
    wider = ("world",)
    tried_last = True
    contains = ("air_drag",)
    axes = AXES

    def __post_init__(self) -> None:
        non_negative(self.key, "drag", self.drag)
        wanted = self._velocities(self.target)
        for name in ("velocity", "velocity_x", "velocity_y"):
            if (getattr(self, name) is not None) != (name in wanted):
                raise BadInput(f"{self.key}.{name} does not fit the target", f"give bounds of {', '.join(wanted)}")

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """c as for air drag; w up to a near gale, either way."""
        bounds = Parameter(-STRONGEST, STRONGEST, "m/s")
        return cls(target, largest_drag(scales), **dict.fromkeys(cls._velocities(target), bounds))

    @property
    def parameters(self) -> ParameterSpace:
        """``drag``, and ``velocity`` or ``velocity_x`` and ``velocity_y``."""
        return ParameterSpace({"drag": self.drag, **{v: getattr(self, v) for v in self._velocities(self.target)}})

    @property
    def neutral(self) -> Mapping[str, float]:
        """c = 0, w = 0."""
        return {"drag": 0.0, **dict.fromkeys(self._velocities(self.target), 0.0)}

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """A small drag in a breeze and in a strong wind from either side."""
        found = []
        for name in self._velocities(self.target):
            bounds: Parameter = getattr(self, name)
            for part in (0.2, 0.4, 0.6, 0.8):
                drag = self.drag.low + 0.002 * (self.drag.high - self.drag.low)
                found.append({**self.neutral, "drag": drag, name: bounds.low + part * (bounds.high - bounds.low)})
        return tuple(found)

    @property
    def element(self) -> str:
        """The body, or ``"world"``."""
        return split_axis(self.target, AXES)[0]

    @staticmethod
    def _velocities(target: str) -> tuple[str, ...]:
        return ("velocity",) if split_axis(target, AXES)[1] else ("velocity_x", "velocity_y")
