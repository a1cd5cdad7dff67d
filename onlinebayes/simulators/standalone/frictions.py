"""Laws of a joint that MuJoCo has no term for, without memory: frictions by speed and load, cogging."""

from __future__ import annotations

import math
from dataclasses import dataclass

from onlinebayes.simulators.standalone.law import Law, Seen, gauss


@dataclass
class Stribeck(Law):
    """Dry friction of size Fc + (Fs - Fc) exp(-(v / vs)^2) [N, N m; m/s, rad/s]."""

    coulomb: float
    static: float
    stribeck_velocity: float

    def bound(self, seen: Seen) -> float:
        """The size at this speed."""
        near = gauss(seen.v / self.stribeck_velocity)
        return self.coulomb * (1.0 - near) + self.static * near


@dataclass
class LoadFriction(Law):
    """Dry friction of size mu abs(f), f the actuators' force at the joint; mu in 1."""

    mu: float

    def bound(self, seen: Seen) -> float:
        """The size under this load."""
        return self.mu * abs(seen.drive)


@dataclass
class LoadStribeck(Law):
    """Dry friction of size mu abs(f) exp(-(v / vs)^2) [1; m/s, rad/s]."""

    mu: float
    stribeck_velocity: float

    def bound(self, seen: Seen) -> float:
        """The size under this load at this speed."""
        return self.mu * abs(seen.drive) * gauss(seen.v / self.stribeck_velocity)


@dataclass
class SquaredLoad(Law):
    """Dry friction of size nu f^2 [1/N, 1/(N m)]."""

    nu: float

    def bound(self, seen: Seen) -> float:
        """The size under this load."""
        return self.nu * seen.drive**2


@dataclass
class Waves(Law):
    """Cogging: A sin(n q + phase) [N, N m; rad/m, 1; rad]."""

    amplitude: float
    poles: float
    phase: float

    def force(self, seen: Seen) -> float:
        """The pull at this position."""
        return self.amplitude * math.sin(self.poles * seen.q + self.phase)
