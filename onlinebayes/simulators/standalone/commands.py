"""Laws of an actuator's command: dead zone, lag, dead time; see the effects of these names."""

from __future__ import annotations

import math
from dataclasses import dataclass

from onlinebayes.simulators.standalone.law import Law, clip


@dataclass
class DeadZone(Law):
    """0 for abs(u) < w, else u - w sign(u) [command units]."""

    width: float

    def command(self, u: float) -> float:
        """u less its part within [-w, w]."""
        return u - clip(u, -self.width, self.width)


@dataclass
class Lag(Law):
    """T du'/dt = u - u', its mean over each timestep; T in seconds."""

    time_constant: float
    remembers = True

    def reset(self, timestep: float) -> None:
        """u' = 0."""
        self.lagged = 0.0
        self.ratio = timestep / max(self.time_constant, 1e-9 * timestep)

    def command(self, u: float) -> float:
        """Mean of u'."""
        away = self.lagged - u
        self.lagged = u + away * math.exp(-self.ratio)
        return u + away * (-math.expm1(-self.ratio) / self.ratio) if self.time_constant > 0 else u


@dataclass
class DeadTime(Law):
    """u(t - T), T in seconds: linear between the commands of two timesteps."""

    delay: float
    remembers = True

    def reset(self, timestep: float) -> None:
        """No command before now."""
        self.whole = math.floor(self.delay / timestep)
        self.part = self.delay / timestep - self.whole
        self.past = [0.0] * (self.whole + 2)

    def command(self, u: float) -> float:
        """The command of T seconds ago."""
        self.past = [*self.past[1:], u]
        far, near = self.past[0], self.past[1]
        return (1 - self.part) * near + self.part * far
