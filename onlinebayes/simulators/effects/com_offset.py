"""A body's centre of mass lies elsewhere: c -> c + d in the body's frame, the inertia about it stays.

``com_offset@body`` moves it along all three axes, ``com_offset@body.x`` along one;
criticism tries one axis at a time, for what two axes do together cannot be told from what one does before it moves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects.base import Effect, split_axis
from onlinebayes.simulators.effects.scales import Scales

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class ComOffset(Effect):
    """The centre of mass of a body moves.

    Args:
        target: body that a joint moves, or ``body.x``, ``body.y``, ``body.z`` for one axis.
        x, y, z: bounds of the offset along the body's axes [m]; those that the target leaves out are None.
    """

    target: str
    x: Parameter | None = None
    y: Parameter | None = None
    z: Parameter | None = None
    name = "com_offset"
    target_kind = "body"
    axes = AXES
    same_law_as = ("body.*.ipos[0]", "body.*.ipos[1]", "body.*.ipos[2]")

    def __post_init__(self) -> None:
        wanted = self._axes()
        for axis in AXES:
            if (getattr(self, axis) is not None) != (axis in wanted):
                raise BadInput(f"{self.key}.{axis} does not fit the target", f"give bounds of {', '.join(wanted)}")

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """Up to the body's size, either way."""
        axis = split_axis(target, AXES)[1]
        bounds = Parameter(-scales.length, scales.length, "m")
        return cls(target, **dict.fromkeys((axis,) if axis else AXES, bounds))

    @property
    def parameters(self) -> ParameterSpace:
        """``x``, ``y``, ``z``, or the target's one axis."""
        return ParameterSpace({axis: getattr(self, axis) for axis in self._axes()})

    @property
    def neutral(self) -> Mapping[str, float]:
        """No offset."""
        return dict.fromkeys(self._axes(), 0.0)

    @property
    def element(self) -> str:
        """The body."""
        return split_axis(self.target, AXES)[0]

    def _axes(self) -> tuple[str, ...]:
        axis = split_axis(self.target, AXES)[1]
        return (axis,) if axis else AXES
