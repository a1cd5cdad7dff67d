"""Typical sizes at a target: what the model and a measurement say of how large an effect there could be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from onlinebayes.parameters import Parameter

ANY = Parameter(0.0, 1.0)
"""Bounds where none are known."""


@dataclass(frozen=True)
class Contact:
    """A geom's contact properties in the model; MuJoCo's defaults where none are given.

    Args:
        friction: sliding coefficient [1].
        time_constant: of the penetration's decay [s].
        damping_ratio: of that decay [1].
        covered: whether other targets mean the same geoms, so that this one is tried where it is named.
    """

    friction: float = 1.0
    time_constant: float = 0.02
    damping_ratio: float = 1.0
    covered: bool = False


@dataclass(frozen=True)
class Scales:
    """Typical sizes at a target, from which an effect takes the bounds of its parameters.

    Args:
        force: largest generalised force in play at the joint [N, N m]; for an actuator, at its transmission.
        speed: largest speed [m/s, rad/s]; of a body and of the world, about how fast bodies move [m/s].
        travel: range of the position [m, rad].
        time: longest plausible dead time [s].
        unit: the joint's kind, which decides the units.
        centre: middle of the positions visited [m, rad].
        inertia: that a force at the joint moves [kg, kg m2]; of a body, its mass [kg]; of the world, the largest.
        length: size of a body [m].
        output: largest force of an actuator itself, before its gear [N, N m].
        contact: of a geom, how the model has its contacts.
        bounds: of a parameter, its own.
        span: of a parameter and of a signal, the first and the last instant of what was measured [s].
    """

    force: float
    speed: float
    travel: float
    time: float
    unit: Literal["slide", "hinge"] = "hinge"
    centre: float = 0.0
    inertia: float = 1.0
    length: float = 0.1
    output: float = 1.0
    contact: Contact = Contact()
    bounds: Parameter = ANY
    span: tuple[float, float] = (0.0, 1.0)
