"""Moments of inertia that follow a free mass: the same body, denser, in place of a point mass at its centre.

    I(m) = (m / m0) I0,     I0, m0 the model's own

MuJoCo's ``body_mass`` is the mass alone. Of a link that is heavier than its file says, both accounts are possible: more
metal everywhere, or a weight at the centre. They differ by what the body turns: see decision 0025.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import mujoco
import numpy as np

MASS, INERTIA = "body_mass", "body_inertia"


def followers(model: mujoco.MjModel, cells: Iterable[tuple[str, tuple[int | slice, ...]]]) -> tuple[int, ...]:
    """Ids of the bodies that turn, whose mass is free and whose moments are not.

    Args:
        model: the compiled model.
        cells: array and index of everything that parameters set.
    """
    rows = np.arange(model.nbody)
    free: dict[str, set[int]] = {MASS: set(), INERTIA: set()}
    for array, index in cells:
        if array in free:
            free[array].update(int(i) for i in np.atleast_1d(rows[index[0]]))
    massive = sorted(free[MASS] - free[INERTIA])
    return tuple(i for i in massive if model.body_mass[i] > 0 and model.body_inertia[i].any() and _turns(model, i))


def _turns(model: mujoco.MjModel, body: int) -> bool:
    """Check whether a joint between the world and the body is more than a slide."""
    while body:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        if (model.jnt_type[first : first + count] != mujoco.mjtJoint.mjJNT_SLIDE).any():
            return True
        body = int(model.body_parentid[body])
    return False


def follow(fields: Mapping[str, np.ndarray], bodies: Iterable[int], model: mujoco.MjModel) -> None:
    """Set the moments of these bodies by their masses, in the fields (N, bodies, ..) of N worlds."""
    for body in bodies:
        factor = fields[MASS][:, body] / model.body_mass[body]
        fields[INERTIA][:, body] = factor[:, None] * model.body_inertia[body]
