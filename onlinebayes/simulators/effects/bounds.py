"""What the bounds of an effect's parameters must obey."""

from __future__ import annotations

from onlinebayes.parameters import Parameter
from onlinebayes.runs import BadInput


def non_negative(key: str, name: str, parameter: Parameter) -> None:
    """Raise :class:`BadInput` for a friction, drag, stiffness or time whose bounds reach below zero."""
    if parameter.low < 0:
        raise BadInput(f"{key}.{name} may be {parameter.low:g} {parameter.unit}", "it is never negative: start at 0")


def joint_unit(unit: str, slide: str, hinge: str) -> str:
    """The unit for a slide or a hinge joint."""
    return slide if unit == "slide" else hinge
