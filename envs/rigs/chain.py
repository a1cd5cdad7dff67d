"""A serial arm of six hinges: M and c from the Jacobians of its links.

    M = sum_k m_k Jp_k' Jp_k + Jw_k' I_k Jw_k
    c = sum_k Jp_k' m_k (Jp_k' v - g) + Jw_k' (I_k Jw_k' v + w_k x I_k w_k)        ' on the right: the rate of change

The velocity-product accelerations come from one pass outwards along the arm (Featherstone, Rigid Body Dynamics
Algorithms, 2008, chapter 5, with all vectors in the world's axes).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from envs.rigs.equations import Equations, Values, gravity, mass, offset

AXES = "zyyzyz"  # of the hinges, in their own link's frame
HINGES = ((0, 0, 0.15), (0, 0, 0.12), (0, 0, 0.36), (0.03, 0, 0.25), (0, 0, 0.1), (0, 0, 0.09))  # from the last [m]
CENTRES = ((0, 0, 0.05), (0, 0.02, 0.18), (0.02, 0, 0.12), (0, 0, 0.05), (0, 0, 0.04), (0.03, 0, 0.03))  # [m]
INERTIAS = (
    (0.012, 0.012, 0.009),
    (0.06, 0.06, 0.01),
    (0.02, 0.02, 0.005),
    (0.003, 0.003, 0.002),
    (0.002, 0.002, 0.001),
    (0.0004, 0.0004, 0.0003),
)  # about each link's centre of mass, along its axes [kg m2]


@final
@dataclass(frozen=True)
class _Pose:
    """Pose of the links: rotations (6, R, 3, 3), hinge axes and points, centres of mass (6, R, 3)."""

    rotation: ndarray
    axis: ndarray
    hinge: ndarray
    centre: ndarray


@final
@dataclass(frozen=True)
class SixJoint(Equations):
    """The arm.

    Args:
        masses: of the links (6,) [kg].
        centres: of mass, in the links' frames (6, 3) [m].
        pull: gravity in the world [m/s2].
    """

    masses: Float[ndarray, " 6"]
    centres: Float[ndarray, "6 3"]
    pull: Float[ndarray, " 3"]

    def inertia(self, q: Float[ndarray, "R 6"]) -> Float[ndarray, "R 6 6"]:
        """M(q)."""
        return self.terms(q, np.zeros_like(q))[0]

    def bias(self, q: Float[ndarray, "R 6"], v: Float[ndarray, "R 6"]) -> Float[ndarray, "R 6"]:
        """c(q, v)."""
        return self.terms(q, v)[1]

    def terms(
        self, q: Float[ndarray, "R 6"], v: Float[ndarray, "R 6"]
    ) -> tuple[Float[ndarray, "R 6 6"], Float[ndarray, "R 6"]]:
        """M(q) and c(q, v) from one set of Jacobians."""
        pose = self._pose(q)
        Jp, Jw, turned = self._jacobians(pose)
        spin, alpha, linear = self._products(pose, v)
        m = self.masses[:, None, None]
        torque = _apply(turned, alpha) + _cross(spin, _apply(turned, spin))
        M = Jp.swapaxes(-1, -2) @ (m[..., None] * Jp) + Jw.swapaxes(-1, -2) @ (turned @ Jw)
        c = _apply(Jp.swapaxes(-1, -2), m * (linear - self.pull)) + _apply(Jw.swapaxes(-1, -2), torque)
        return M.sum(0), c.sum(0)

    def potential(self, q: Float[ndarray, "R 6"]) -> Float[ndarray, " R"]:
        """-sum m g . p."""
        return -np.einsum("k,krx,x->r", self.masses, self._pose(q).centre, self.pull)

    @staticmethod
    def of(values: Values) -> SixJoint:
        """The arm with these masses and centres of mass."""
        links = [f"link{k}" for k in range(1, 7)]
        centres = np.array(CENTRES) + np.array([offset(values, link) for link in links])
        return SixJoint(np.array([mass(values, link) for link in links]), centres, gravity(values))

    def _pose(self, q: Float[ndarray, "R 6"]) -> _Pose:
        R, (sine, cosine) = len(q), (np.sin(q), np.cos(q))
        pose = _Pose(np.empty((6, R, 3, 3)), np.empty((6, R, 3)), np.empty((6, R, 3)), np.empty((6, R, 3)))
        at, turn = np.zeros((R, 3)), np.broadcast_to(np.eye(3), (R, 3, 3))
        for k, axis in enumerate(AXES):
            at = at + turn @ np.array(HINGES[k], float)
            pose.axis[k], pose.hinge[k] = turn[:, :, "xyz".index(axis)], at
            turn = turn @ _rotations(axis, sine[:, k], cosine[:, k])
            pose.rotation[k], pose.centre[k] = turn, at + turn @ self.centres[k]
        return pose

    def _jacobians(self, pose: _Pose) -> tuple[ndarray, ndarray, ndarray]:
        """Of the centres and the rotations, (6, R, 3, 6), and the links' inertias in the world's axes."""
        carried = np.tril(np.ones((6, 6)))[:, None, :, None]  # link k is carried by joints 0 to k
        arms = pose.centre[:, :, None] - pose.hinge.swapaxes(0, 1)[None]
        axes = np.broadcast_to(pose.axis.swapaxes(0, 1)[None], arms.shape)
        turned = (pose.rotation * np.array(INERTIAS)[:, None, None, :]) @ pose.rotation.swapaxes(-1, -2)
        return (carried * _cross(axes, arms)).swapaxes(-1, -2), (carried * axes).swapaxes(-1, -2), turned

    def _products(self, pose: _Pose, v: Float[ndarray, "R 6"]) -> tuple[ndarray, ndarray, ndarray]:
        """Angular velocities, and angular and linear accelerations of the centres at zero joint acceleration."""
        rate = pose.axis * v.T[:, :, None]
        spin = np.cumsum(rate, 0)
        before = spin - rate  # of the link that carries the hinge
        turning = _cross(before, rate)
        alpha = np.cumsum(turning, 0)
        reach, arm = np.diff(pose.hinge, axis=0, prepend=pose.hinge[:1]), pose.centre - pose.hinge
        hinges = np.cumsum(_cross(alpha - turning, reach) + _cross(before, _cross(before, reach)), 0)
        return spin, alpha, hinges + _cross(alpha, arm) + _cross(spin, _cross(spin, arm))


def _apply(A: ndarray, x: ndarray) -> ndarray:
    """A x, link by link and run by run."""
    return (A @ x[..., None])[..., 0]


def _cross(a: ndarray, b: ndarray) -> ndarray:
    """a x b along the last axis; numpy's own is several times slower on small arrays."""
    a0, a1, a2 = a[..., 0], a[..., 1], a[..., 2]
    b0, b1, b2 = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0], -1)


def _rotations(axis: str, sine: Float[ndarray, " R"], cosine: Float[ndarray, " R"]) -> Float[ndarray, "R 3 3"]:
    """Rotations about an axis of the frame."""
    first, second = {"y": (2, 0), "z": (0, 1)}[axis]
    turn = np.zeros((len(sine), 3, 3))
    turn[:, "xyz".index(axis), "xyz".index(axis)] = 1.0
    turn[:, first, first] = turn[:, second, second] = cosine
    turn[:, first, second], turn[:, second, first] = -sine, sine
    return turn
