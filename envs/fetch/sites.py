r"""Where a site of each world is, how it is turned and how it moves.

    v = v_c + omega x (x - x_c),     v_c, omega the spatial velocity of its body at the point x_c

MuJoCo keeps the spatial velocity of a body at the centre of mass of its tree of bodies (``cvel``, ``subtree_com``).
Euler angles are of the frame that turns about x, then y, then z, as in Gymnasium-Robotics.
"""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

EPS = 4 * np.finfo(float).eps
"""Below this cosine x is said to be 0: where y is a quarter turn, x and z are one angle."""


class Site:
    """One site in all worlds of a batch; reads what the engine worked out last.

    Args:
        batch: the worlds.
        model: of the site.
        name: of the site.
    """

    def __init__(self, batch: mujoco.batch.Batch, model: mujoco.MjModel, name: str) -> None:
        site = int(model.site(name).id)
        body = int(model.site_bodyid[site])
        root = int(model.body_rootid[body])
        self._place, self._axes = batch.bind("site_xpos")[:, site], batch.bind("site_xmat")[:, site]
        self._velocity, self._centre = batch.bind("cvel")[:, body], batch.bind("subtree_com")[:, root]

    def place(self) -> Float[np.ndarray, "N 3"]:
        """Place [m]."""
        return self._place.copy()

    def velocity(self) -> Float[np.ndarray, "N 3"]:
        """Velocity [m/s]."""
        return self._velocity[:, 3:] + np.cross(self._velocity[:, :3], self._place - self._centre)

    def angular_velocity(self) -> Float[np.ndarray, "N 3"]:
        """Angular velocity [rad/s]."""
        return self._velocity[:, :3].copy()

    def euler(self) -> Float[np.ndarray, "N 3"]:
        """Angles about x, y, z [rad]."""
        m = self._axes.reshape(-1, 3, 3)
        cosine = np.hypot(m[:, 2, 2], m[:, 1, 2])
        regular = cosine > EPS
        x = np.where(regular, -np.arctan2(m[:, 1, 2], m[:, 2, 2]), 0.0)
        z = np.where(regular, -np.arctan2(m[:, 0, 1], m[:, 0, 0]), -np.arctan2(-m[:, 1, 0], m[:, 1, 1]))
        return np.stack([x, np.arctan2(m[:, 0, 2], cosine), z], axis=-1)
