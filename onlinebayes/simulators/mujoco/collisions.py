"""The pairs of geoms that can touch in a model, by MuJoCo's rules for masks, bodies and exclusions.

    their masks fit:        (contype_1 & conaffinity_2) | (contype_2 & conaffinity_1) != 0
    their bodies move against each other, are not parent and child, and not excluded

(MuJoCo's documentation, "Computation", section "Collision detection".) Pairs given by name follow other rules.
"""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Bool


def may_touch(model: mujoco.MjModel) -> Bool[np.ndarray, "G G"]:
    """Return a mask of the pairs of geoms i, j that can touch; ``<pair>`` elements are left out of account."""
    body = model.geom_bodyid.astype(np.int64)
    weld, parent = model.body_weldid[body], model.body_weldid[model.body_parentid[model.body_weldid[body]]]
    fits = model.geom_contype[:, None] & model.geom_conaffinity != 0
    can = (fits | fits.T) & (weld[:, None] != weld)
    if not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FILTERPARENT:
        child = (parent[:, None] == weld) & (weld[:, None] != 0) & (weld != 0)
        can &= ~(child | child.T)
    pair = (np.minimum(body[:, None], body) << 16) + np.maximum(body[:, None], body)
    return can & ~np.isin(pair, model.exclude_signature)


def can_touch(model: mujoco.MjModel) -> bool:
    """Check whether any contact is possible in a model; without one, a search for contacts is wasted at each step."""
    return bool(model.npair or model.nflex or may_touch(model).any())
