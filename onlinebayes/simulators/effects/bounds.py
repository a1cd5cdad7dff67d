"""Rules for the bounds of an effect's parameters, and what follows from the bounds: starting values, units."""

from __future__ import annotations

from collections.abc import Sequence

from onlinebayes.parameters import Parameter
from onlinebayes.runs import BadInput


def non_negative(key: str, name: str, parameter: Parameter) -> None:
    """Raise :class:`BadInput` for a friction, drag, stiffness or time whose bounds reach below zero."""
    if parameter.low < 0:
        raise BadInput(f"{key}.{name} may be {parameter.low:g} {parameter.unit}", "it is never negative: start at 0")


def divides(key: str, name: str, parameter: Parameter) -> None:
    """Raise :class:`BadInput` for what a friction is divided by, if its bounds reach zero."""
    if parameter.low <= 0:
        raise BadInput(f"{key}.{name} may be {parameter.low:g}", "the friction is divided by it: stay above 0")


def geometric(bounds: Parameter, part: float) -> float:
    """The value at a part of the way between positive bounds, on a logarithmic scale."""
    return float(bounds.low ** (1 - part) * bounds.high**part)


def starts_within(name: str, bounds: Parameter, parts: Sequence[float]) -> tuple[dict[str, float], ...]:
    """Starting values of one parameter, at these parts of the way from its lower bound to its upper one.

    Args:
        name: short name of the parameter.
        bounds: its bounds.
        parts: from 0 (the lower bound) to 1 (the upper one), one a start.
    """
    low, width = bounds.low, bounds.high - bounds.low
    return tuple({name: low + part * width} for part in parts)


def joint_unit(unit: str, slide: str, hinge: str) -> str:
    """The unit for a slide or a hinge joint."""
    return slide if unit == "slide" else hinge
