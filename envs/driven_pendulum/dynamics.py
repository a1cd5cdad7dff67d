"""The rig's own integrator: a driven pendulum with true stick and an exact delay, none of it MuJoCo's.

    I q'' = u(t - T) - m g l sin q - d q' - k (q - q0) - c q' |q'| - F s,      I = m l^2 + i

    s = sign(q') while it slips; at q' = 0 it sticks, exactly, as long as |all other torques| <= F

Between two changes of the delayed command the torque is smooth while the hinge slips, and constant while it sticks.
So an interval is one Runge-Kutta step (4th order), cut where the velocity reaches zero (Newton on the step's length)
and where the delayed command changes; breaking away needs no search, for it happens at such a change only.

| equation         | code                              |
|------------------|-----------------------------------|
| torques but F s  | :meth:`Pendulum.torque`           |
| slip             | :meth:`Pendulum.slip`             |
| stop, stick      | :meth:`Pendulum.advance`          |
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

LENGTH = 0.3  # rod, from the hinge to the bob [m]
BOB_INERTIA = 1e-6  # of the bob about its own centre [kg m2]
GRAVITY = 9.81  # [m/s2]
NEWTON_STEPS = 4  # the stop's time converges quadratically; four reach round-off from a secant's start


@dataclass(frozen=True)
class Pendulum:
    """The physics of N worlds, one value each.

    Args:
        mass: m of the bob [kg].
        damping: d, viscous [N m s/rad].
        frictionloss: F, dry friction [N m].
        drag: c, quadratic [N m s2/rad2].
        stiffness: k of a spring at the hinge [N m/rad].
        springref: q0, where that spring is at rest [rad].
    """

    mass: Float[Tensor, " N"]
    damping: Float[Tensor, " N"]
    frictionloss: Float[Tensor, " N"]
    drag: Float[Tensor, " N"]
    stiffness: Float[Tensor, " N"]
    springref: Float[Tensor, " N"]

    def rows(self, index: Int[Tensor, " K"]) -> Pendulum:
        """The same physics for some of the worlds."""
        return Pendulum(**{name: value[index] for name, value in vars(self).items()})

    @property
    def inertia(self) -> Float[Tensor, " N"]:
        """I about the hinge [kg m2]."""
        return self.mass * LENGTH**2 + BOB_INERTIA

    def torque(self, q: Float[Tensor, " N"], v: Float[Tensor, " N"], u: Float[Tensor, " N"]) -> Float[Tensor, " N"]:
        """All torques but dry friction at angle q [rad], speed v [rad/s] and motor torque u [N m]."""
        gravity = self.mass * (GRAVITY * LENGTH) * torch.sin(q)
        return u - gravity - (self.damping + self.drag * v.abs()) * v - self.stiffness * (q - self.springref)

    def slip(
        self, q: Float[Tensor, " N"], v: Float[Tensor, " N"], u: Float[Tensor, " N"], h: Float[Tensor, " N"], s: Tensor
    ) -> tuple[Float[Tensor, " N"], Float[Tensor, " N"]]:
        """Angle and speed after h seconds of slipping in direction s (-1 or 1): one classical Runge-Kutta step."""
        load, inertia = u - s * self.frictionloss, self.inertia
        half = 0.5 * h
        a1 = self.torque(q, v, load) / inertia
        v2 = v + half * a1
        a2 = self.torque(q + half * v, v2, load) / inertia
        v3 = v + half * a2
        a3 = self.torque(q + half * v2, v3, load) / inertia
        v4 = v + h * a3
        a4 = self.torque(q + h * v3, v4, load) / inertia
        return q + h / 6 * (v + 2 * (v2 + v3) + v4), v + h / 6 * (a1 + 2 * (a2 + a3) + a4)

    def advance(
        self, q: Float[Tensor, " N"], v: Float[Tensor, " N"], u: Float[Tensor, " N"], h: Float[Tensor, " N"]
    ) -> tuple[Float[Tensor, " N"], Float[Tensor, " N"]]:
        """Angle and speed after h seconds (short: one stop at most) under the constant motor torque u."""
        s = self._direction(q, v, u)
        q1, v1 = self.slip(q, v, u, h, s)
        stuck = s == 0
        q1, v1 = torch.where(stuck, q, q1), torch.where(stuck, v, v1)
        # Without dry friction nothing happens at zero speed: only rubbing worlds are cut there.
        stops = ((s * v1 < 0) & (self.frictionloss > 0)).nonzero().squeeze(-1)
        if stops.numel():
            q1[stops], v1[stops] = self.rows(stops)._through_zero(q[stops], v[stops], u[stops], h[stops], v1[stops])
        return q1, v1

    def _direction(self, q: Tensor, v: Tensor, u: Tensor) -> Tensor:
        """1 or -1 where it slips or breaks away, 0 where it sticks."""
        torque = self.torque(q, torch.zeros_like(v), u)
        breaks = torch.where(torque.abs() > self.frictionloss, torque.sign(), torch.zeros_like(torque))
        return torch.where(v == 0, breaks, v.sign())

    def _through_zero(self, q: Tensor, v: Tensor, u: Tensor, h: Tensor, v1: Tensor) -> tuple[Tensor, Tensor]:
        """An interval in which the hinge stops: up to the stop, then stick or slip the other way."""
        s = v.sign()
        stop = h * v / (v - v1)
        for _ in range(NEWTON_STEPS):
            at, speed = self.slip(q, v, u, stop, s)
            slope = self.torque(at, speed, u - s * self.frictionloss) / self.inertia
            stop = torch.minimum((stop - speed / slope).clamp(min=0), h)
        at, _ = self.slip(q, v, u, stop, s)
        still = torch.zeros_like(v)
        onward = self._direction(at, still, u)
        q1, v1 = self.slip(at, still, u, h - stop, onward)
        return torch.where(onward == 0, at, q1), torch.where(onward == 0, still, v1)
