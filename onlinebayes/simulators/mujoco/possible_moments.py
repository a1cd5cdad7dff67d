"""Principal moments that no body has, and the nearest that one could have: a file with the former does not compile.

    A + B >= C  for the largest moment C;    nearest (least squares):  A + s, B + s, C - s  with  s = (C - A - B) / 3

Each moment is the sum of two of the three second moments of the mass, none of which is negative. A search that frees
one moment alone (``body.x.inertia[i]``) may leave them; worlds step with such moments all the same.
"""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

from onlinebayes.simulators.mujoco.addresses import names

FIELD = "body_inertia"


def rigid(moments: Float[np.ndarray, "bodies 3"]) -> Float[np.ndarray, "bodies 3"]:
    """The nearest moments that bodies can have [kg m2]; those that can be stay to the last bit."""
    nearest = moments.copy()
    for row in nearest:
        a, b, c = np.argsort(row)
        if (excess := row[c] - row[a] - row[b]) > 0:
            row[[a, b]] += excess / 3
            row[c] = row[a] + row[b]
    return nearest


def not_rigid(
    model: mujoco.MjModel, moments: Float[np.ndarray, "bodies 3"], base: Float[np.ndarray, "bodies 3"]
) -> tuple[str, ...]:
    """Names of the bodies whose moments differ from the model's own and are none that a body has."""
    wrong = (moments != base).any(1) & (moments != rigid(moments)).any(1)
    return tuple(name for name, is_wrong in zip(names(model, "body"), wrong, strict=True) if is_wrong)
