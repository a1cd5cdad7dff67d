"""Air drag of a body: f = -c abs(v) v at its centre of mass, in a fluid at rest.

For a body of area A, c = rho C_d A / 2. ``air_drag@world`` drags every body that moves: the largest with c, the others
less by the square of their size. Along a single joint it is that joint's :mod:`.quadratic_drag`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.bounds import non_negative
from onlinebayes.simulators.effects.scales import Scales

GRAVITY = 9.81  # [m/s2]


@dataclass(frozen=True)
class AirDrag(Effect):
    """Quadratic drag of a body's centre of mass, or of all bodies.

    Args:
        target: body that a joint moves, or ``"world"``.
        drag: bounds of c >= 0 [N s2/m2].
    """

    target: str
    drag: Parameter
    name = "air_drag"
    target_kind = "body"
    wider = ("world",)

    def __post_init__(self) -> None:
        non_negative(self.key, "drag", self.drag)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """See :func:`largest_drag`."""
        return cls(target, largest_drag(scales))

    @property
    def parameters(self) -> ParameterSpace:
        """``drag``."""
        return ParameterSpace({"drag": self.drag})

    @property
    def neutral(self) -> Mapping[str, float]:
        """c = 0."""
        return {"drag": 0.0}

    def said_by_joints(self, kinds: Mapping[str, str], moving: Sequence[str]) -> bool:
        """Of a body that one slide or hinge moves: it is that joint's quadratic drag."""
        return len(moving) == 1 and bool(kinds.get(moving[0]))


def largest_drag(scales: Scales) -> Parameter:
    """Bounds of c up to the drag of ten times the body's weight at about the speed it moves with."""
    return Parameter(0.0, 10 * GRAVITY * scales.inertia / scales.speed**2, "N s2/m2")
