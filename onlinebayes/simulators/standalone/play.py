"""Free play between an actuator and its joint; equations: :mod:`onlinebayes.simulators.effects.backlash`."""

from __future__ import annotations

from dataclasses import dataclass

from onlinebayes.simulators.standalone.law import Law, Seen, clip, sign


@dataclass
class Play(Law):
    """Play of full width g [m, rad] between an actuator, whose side has the inertia R [kg, kg m2], and its joint.

    The motor's side is at q + offset, as fast as ``speed``. It is ``apart`` in the gap, or at a stop, which it has
    just reached where ``struck``. A blow gives a part of its momentum at once and ``owed`` in the next timestep.
    """

    gap: float
    rotor: float
    remembers = True
    weighs = True

    def reset(self, timestep: float) -> None:
        """The motor in the middle of its play, as fast as the joint."""
        self.offset = self.speed = self.before = self.owed = 0.0
        self.begun = self.touched = self.struck = False

    def force(self, seen: Seen) -> float:
        """In the gap the loss of the actuator's force; at a stop the force on the motor's side, and the blow."""
        _, _, apart, _, push, blow, _ = self.look(seen)
        return (0.0 if apart else push + blow / seen.timestep) - seen.drive if self.gap > 0 else 0.0

    def inertia(self, seen: Seen) -> float:
        """-R in the gap."""
        return -self.rotor if self.gap > 0 and self.look(seen)[2] else 0.0

    def advance(self, seen: Seen) -> None:
        """Place and speed of the motor at the timestep's end; the joint's own way in the gap is not known yet."""
        offset, speed, apart, struck, _, _, owed = self.look(seen)
        servo, rotor, h = seen.servo, self.rotor / seen.timestep, seen.timestep
        pull = servo.force + servo.damping * seen.v - servo.stiffness * offset
        resists = servo.damping + h * servo.stiffness
        force = rotor * (pull - resists * speed) / (rotor + resists)
        after = speed + clip(force, servo.low, servo.high) / rotor if apart else seen.v
        self.offset = offset + 0.5 * h * (speed + after) if apart else offset
        self.speed, self.before, self.owed = after, seen.v, owed
        self.begun, self.touched, self.struck = True, not apart, struck

    def look(self, seen: Seen) -> tuple[float, float, bool, bool, float, float, float]:
        """Return offset, speed, apart, struck, the force at the stop, the blow, and what is owed of it."""
        half, h, servo = self.gap / 2, seen.timestep, seen.servo
        free = self.begun and not self.touched
        speed = self.speed if free else seen.v
        offset = self.offset - (0.5 * h * (self.before + seen.v) if free else 0.0)
        away = speed - seen.v
        side = sign(offset if self.touched else away)
        phi = max((half - side * offset) / max(h * abs(away), 1e-300), 0.0)
        struck = not self.touched and phi <= 1
        push = clip(servo.force - servo.stiffness * side * half, servo.low, servo.high)
        pulled = side * (push - self.rotor * (seen.v - self.before) / h) < 0
        apart = (self.touched and pulled and not self.struck) or (not self.touched and not struck)
        blow, now = (self.rotor * away if struck else 0.0), min(phi, 1.0)
        at_stop = self.touched or struck
        return (
            (side * half if at_stop else offset),
            speed,
            apart,
            struck,
            push,
            (1 - now) * blow + self.owed,
            now * blow,
        )
