"""Equations of motion of the rigs, written out by hand and vectorised over runs.

    M(q) a + c(q, v) = tau          c: Coriolis, centrifugal, gravity, air

A system takes its values from a mapping of addresses [SI]: the base parameters, and of the hidden effects those that
change masses, gravity or the air. All others are laws of joints, actuators and sensors.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float
from numpy import ndarray

GRAVITY = 9.81  # [m/s2]
TABLE = 1e9  # what a table opposes to a body that presses on it [N]: it never gives way

Values = Mapping[str, float]


def gravity(values: Values) -> Float[ndarray, " 3"]:
    """The acceleration of gravity [m/s2], turned from the vertical towards +x by ``gravity_tilt@world.angle``."""
    angle = values.get("gravity_tilt@world.angle", 0.0)
    return GRAVITY * np.array([math.sin(angle), 0.0, -math.cos(angle)])


def offset(values: Values, body: str) -> Float[ndarray, " 3"]:
    """By how much a body's centre of mass lies off its place in the model [m]."""
    return np.array([values.get(f"com_offset@{body}.{axis}", 0.0) for axis in "xyz"])


def mass(values: Values, body: str) -> float:
    """A body's mass with what it carries [kg]."""
    return values[f"body.{body}.mass"] + values.get(f"payload@{body}.mass", 0.0)


class Equations(ABC):
    """M and c of a system with n coordinates, for R runs at once."""

    @abstractmethod
    def inertia(self, q: Float[ndarray, "R n"]) -> Float[ndarray, "R n n"]:
        """M(q) [kg, kg m, kg m2]."""

    @abstractmethod
    def bias(self, q: Float[ndarray, "R n"], v: Float[ndarray, "R n"]) -> Float[ndarray, "R n"]:
        """c(q, v) [N, N m]."""

    def terms(
        self, q: Float[ndarray, "R n"], v: Float[ndarray, "R n"]
    ) -> tuple[Float[ndarray, "R n n"], Float[ndarray, "R n"]]:
        """M(q) and c(q, v); together, for systems in which they share work."""
        return self.inertia(q), self.bias(q, v)

    def energy(self, q: Float[ndarray, "R n"], v: Float[ndarray, "R n"]) -> Float[ndarray, " R"]:
        """Kinetic plus potential energy [J]."""
        return 0.5 * np.einsum("ri,rij,rj->r", v, self.inertia(q), v) + self.potential(q)

    @abstractmethod
    def potential(self, q: Float[ndarray, "R n"]) -> Float[ndarray, " R"]:
        """Potential energy [J]."""

    def sliding_friction(self, joints: int) -> Float[ndarray, " n"]:
        """Coulomb friction that contacts add [N]; none but for a block on a table."""
        return np.zeros(joints)


@final
@dataclass(frozen=True)
class Lever(Equations):
    """A rigid body on a horizontal hinge along y, hanging at q = 0.

    Args:
        mass: m [kg].
        inertia_yy: of the body about its own centre [kg m2].
        centre: centre of mass at q = 0 from the hinge, (x, z) [m].
        pull: gravity, (x, z) [m/s2].
    """

    mass: float
    inertia_yy: float
    centre: tuple[float, float]
    pull: tuple[float, float]

    def inertia(self, q: Float[ndarray, "R 1"]) -> Float[ndarray, "R 1 1"]:
        """m |p|^2 + I."""
        x, z = self.centre
        return np.full((len(q), 1, 1), self.mass * (x * x + z * z) + self.inertia_yy)

    def bias(self, q: Float[ndarray, "R 1"], v: Float[ndarray, "R 1"]) -> Float[ndarray, "R 1"]:
        """-m g . dp/dq,  p = (x cos q + z sin q, -x sin q + z cos q)."""
        (x, z), (gx, gz) = self.centre, self.pull
        sine, cosine = np.sin(q), np.cos(q)
        return -self.mass * (gx * (z * cosine - x * sine) - gz * (x * cosine + z * sine))

    def potential(self, q: Float[ndarray, "R 1"]) -> Float[ndarray, " R"]:
        """-m g . p."""
        (x, z), (gx, gz) = self.centre, self.pull
        sine, cosine = np.sin(q[:, 0]), np.cos(q[:, 0])
        return -self.mass * (gx * (x * cosine + z * sine) + gz * (z * cosine - x * sine))

    @staticmethod
    def of(values: Values, body: str, length: float, inertia: float) -> Lever:
        """A lever whose centre of mass hangs ``length`` [m] below the hinge."""
        shift, pull = offset(values, body), gravity(values)
        return Lever(mass(values, body), inertia, (shift[0], shift[2] - length), (pull[0], pull[2]))


@final
@dataclass(frozen=True)
class Translation(Equations):
    """A body that translates along some of the axes x, y, z, in air and possibly on a rough plane.

    Args:
        mass: m [kg].
        pull: gravity along the free axes [m/s2].
        air: k of the drag -k (v - w) |v - w| [N s2/m2].
        wind: w along the free axes [m/s].
        friction: mu m g, the Coulomb friction of a table under the body [N]; it acts along the first axis, and the
            last one, the vertical, is held by the table.
    """

    mass: float
    pull: tuple[float, ...]
    air: float
    wind: tuple[float, ...]
    friction: float = 0.0

    def inertia(self, q: Float[ndarray, "R n"]) -> Float[ndarray, "R n n"]:
        """m times the identity."""
        return np.broadcast_to(self.mass * np.eye(q.shape[1]), (len(q), q.shape[1], q.shape[1]))

    def bias(self, q: Float[ndarray, "R n"], v: Float[ndarray, "R n"]) -> Float[ndarray, "R n"]:
        """k (v - w) |v - w| - m g."""
        relative = v - np.array(self.wind)
        drag = self.air * np.sqrt((relative**2).sum(1, keepdims=True)) * relative
        return drag - self.mass * np.array(self.pull)

    def potential(self, q: Float[ndarray, "R n"]) -> Float[ndarray, " R"]:
        """-m g . q."""
        return -self.mass * q @ np.array(self.pull)

    def sliding_friction(self, joints: int) -> Float[ndarray, " n"]:
        """Along the first coordinate; the last is held."""
        return np.array([self.friction, TABLE]) if self.friction else np.zeros(joints)

    @staticmethod
    def of(values: Values, body: str, axes: str, roughness: float = 0.0) -> Translation:
        """A body free along ``axes``, on a table of that friction coefficient."""
        kept = ["xyz".index(axis) for axis in axes]
        pull, m = gravity(values), mass(values, body)
        wind = tuple(values.get(f"wind@world.{axis}", 0.0) for axis in axes)
        air = values.get(f"air_drag@{body}.drag", values.get("wind@world.drag", 0.0))
        return Translation(m, tuple(pull[kept]), air, wind, roughness * m * abs(pull[2]))


@final
@dataclass(frozen=True)
class CartPole(Equations):
    """A cart on a horizontal rail along x with a lever hinged to it along y, hanging at q = 0.

    Args:
        cart: mass of the cart [kg].
        pole: the lever.
    """

    cart: float
    pole: Lever

    def inertia(self, q: Float[ndarray, "R 2"]) -> Float[ndarray, "R 2 2"]:
        """[[M + m, m p_x'], [m p_x', I]]."""
        M = np.empty((len(q), 2, 2))
        M[:, 0, 0] = self.cart + self.pole.mass
        M[:, 0, 1] = M[:, 1, 0] = self.pole.mass * self._slope(q)
        M[:, 1, 1] = self.pole.inertia(q[:, 1:])[:, 0, 0]
        return M

    def bias(self, q: Float[ndarray, "R 2"], v: Float[ndarray, "R 2"]) -> Float[ndarray, "R 2"]:
        """[m p_x'' w^2 - (M + m) g_x, gravity's torque]."""
        x, z = self.pole.centre
        curve = -x * np.cos(q[:, 1]) - z * np.sin(q[:, 1])
        rail = self.pole.mass * curve * v[:, 1] ** 2 - (self.cart + self.pole.mass) * self.pole.pull[0]
        return np.column_stack([rail, self.pole.bias(q[:, 1:], v[:, 1:])[:, 0]])

    def potential(self, q: Float[ndarray, "R 2"]) -> Float[ndarray, " R"]:
        """Of the pole, and of both on a rail that is not level."""
        return self.pole.potential(q[:, 1:]) - (self.cart + self.pole.mass) * self.pole.pull[0] * q[:, 0]

    def _slope(self, q: Float[ndarray, "R 2"]) -> Float[ndarray, " R"]:
        x, z = self.pole.centre
        return z * np.cos(q[:, 1]) - x * np.sin(q[:, 1])


@final
@dataclass(frozen=True)
class TwoLink(Equations):
    """Two levers in a vertical plane, the second hinged ``length`` [m] below the first's hinge; both hang at q = 0.

    The second angle is relative to the first link. Source: the double pendulum of any textbook, in phi = q1 + q2.

    Args:
        upper, lower: the levers.
        length: from hinge to hinge [m].
    """

    upper: Lever
    lower: Lever
    length: float

    def inertia(self, q: Float[ndarray, "R 2"]) -> Float[ndarray, "R 2 2"]:
        """With b = m2 L p(q2), the coupling of the links."""
        fore = self.lower.inertia(q[:, 1:])[:, 0, 0]
        couple = self._couple(q)[0]
        M = np.empty((len(q), 2, 2))
        M[:, 0, 0] = self.upper.inertia(q[:, :1])[:, 0, 0] + self.lower.mass * self.length**2 + fore + 2 * couple
        M[:, 0, 1] = M[:, 1, 0] = fore + couple
        M[:, 1, 1] = fore
        return M

    def bias(self, q: Float[ndarray, "R 2"], v: Float[ndarray, "R 2"]) -> Float[ndarray, "R 2"]:
        """Coriolis, centrifugal and gravity."""
        slope, (v1, v2), fall = self._couple(q)[1], v.T, self._falls(q)
        return np.column_stack([slope * (2 * v1 + v2) * v2 + fall[0], -slope * v1**2 + fall[1]])

    def potential(self, q: Float[ndarray, "R 2"]) -> Float[ndarray, " R"]:
        """Of both links."""
        elbow = Lever(self.lower.mass, 0.0, (0.0, -self.length), self.lower.pull)
        upper = self.upper.potential(q[:, :1]) + elbow.potential(q[:, :1])
        return upper + self.lower.potential(q.sum(1, keepdims=True))

    def _couple(self, q: Float[ndarray, "R 2"]) -> tuple[Float[ndarray, " R"], Float[ndarray, " R"]]:
        """m2 L (x sin q2 - z cos q2), the links' coupling, and its slope in q2."""
        (x, z), sine, cosine = self.lower.centre, np.sin(q[:, 1]), np.cos(q[:, 1])
        weight = self.lower.mass * self.length
        return weight * (x * sine - z * cosine), weight * (x * cosine + z * sine)

    def _falls(self, q: Float[ndarray, "R 2"]) -> tuple[Float[ndarray, " R"], Float[ndarray, " R"]]:
        both, first = q.sum(1, keepdims=True), q[:, :1]
        fore = self.lower.bias(both, both)[:, 0]
        elbow = Lever(self.lower.mass, 0.0, (0.0, -self.length), self.lower.pull)
        return self.upper.bias(first, first)[:, 0] + elbow.bias(first, first)[:, 0] + fore, fore
