"""Laws of a motor: the control law of a hobby servo, derating by heat; see the effects of these names."""

from __future__ import annotations

import math
from dataclasses import dataclass

from onlinebayes.simulators.standalone.law import Law, Seen, clip


@dataclass
class HobbyServo(Law):
    """f = (d - b v) / (1 + s d^2), d the limited pull outside the dead band, in the place of the model's actuator.

    ``limit`` is ``math.inf`` where the duty has none [N, N m; N s/m, N m s/rad; m, rad; 1/N2, 1/(N m)2].
    """

    limit: float
    back_emf: float
    dead_band: float
    sag: float

    def force(self, seen: Seen) -> float:
        """f less the force that the actuator has in the model."""
        servo = seen.servo
        half = self.dead_band * servo.stiffness
        pull = servo.force + servo.damping * seen.v
        asked = clip(clip(servo.force - clip(pull, -half, half), servo.low, servo.high), -self.limit, self.limit)
        torque = (asked - self.back_emf * seen.v) / (1.0 + self.sag * asked**2)
        works = servo.low < servo.high
        return (torque if works else 0.0) - clip(servo.force, servo.low, servo.high)


@dataclass
class Heat(Law):
    """f / (1 + c h), T dh/dt = (f / f_ref)^2 - h [1; s; N, N m]."""

    coefficient: float
    time_constant: float
    reference: float
    remembers = True

    def reset(self, timestep: float) -> None:
        """A cold motor."""
        self.heat = 0.0

    def force(self, seen: Seen) -> float:
        """What the motor loses, by its heat in the middle of the timestep."""
        loss = self.coefficient * self.after(seen, 0.5)
        return -seen.drive * loss / (1.0 + loss)

    def advance(self, seen: Seen) -> None:
        """The heat at the timestep's end."""
        self.heat = self.after(seen, 1.0)

    def after(self, seen: Seen, part: float) -> float:
        """The heat after this part of the timestep."""
        kept = math.exp(-part * seen.timestep / self.time_constant)
        return kept * self.heat + (1.0 - kept) * (seen.drive / self.reference) ** 2
