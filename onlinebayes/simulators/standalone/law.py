"""One effect in one world, in floats alone: the form that a file without this library can hold.

    u' = command(u),    tau += force(seen),    F += bound(seen),    I += inertia(seen),    h+ = advance(seen)

The equations are those of :mod:`onlinebayes.simulators.effects`, a law keeps its own hidden state. The source of every
class here is copied into ``refined_model.py``: it uses ``math``, ``numpy``, ``dataclasses`` and these classes only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass
class Servo:
    """The law of an actuator: f(q', v') = clip(force - stiffness (q' - q) - damping (v' - v), low, high) [N, N m]."""

    force: float
    stiffness: float
    damping: float
    low: float
    high: float


@dataclass
class Seen:
    """The inputs of a law at the start of a timestep: its joint's motion, its drive's force, command and servo.

    Args:
        q, v: position and velocity of the joint [m, rad, m/s, rad/s].
        drive: force of the actuators, with what laws at them add [N, N m].
        command: what the actuators receive [command units].
        servo: the joint's only actuator, where it has one.
        timestep: h [s].
    """

    q: float
    v: float
    drive: float
    command: float
    servo: Servo
    timestep: float


class Law:
    """One law; by default it does nothing.

    Attributes:
        remembers: whether it has a hidden state; without one RK4 takes it at the middle of a timestep.
        weighs: whether it changes the inertia of its joint.
    """

    remembers = False
    weighs = False

    def reset(self, timestep: float) -> None:
        """Forget what has happened; a timestep lasts so many seconds."""

    def command(self, u: float) -> float:
        """Return the command that the actuator receives over the next timestep."""
        return u

    def force(self, seen: Seen) -> float:
        """Return the force on the joint, or before the gear of the actuator [N, N m]."""
        return 0.0

    def bound(self, seen: Seen) -> float:
        """Return the bound of a dry friction on the joint [N, N m]."""
        return 0.0

    def inertia(self, seen: Seen) -> float:
        """Return what the joint's inertia changes by [kg, kg m2]."""
        return 0.0

    def advance(self, seen: Seen) -> None:
        """Move the hidden state to the end of the timestep."""

    def sense(self, time: float, value: float, start: float, slope: float) -> float:
        """Return what a sensor shows of a signal; it began at ``start`` and changed by ``slope`` a second."""
        return value


def clip(x: float, low: float, high: float) -> float:
    """Return x within its limits."""
    return min(max(x, low), high)


def sign(x: float) -> float:
    """Return -1, 0 or 1."""
    return float(np.sign(x))


def gauss(x: float) -> float:
    """Return exp(-x^2)."""
    return math.exp(-x * x)
