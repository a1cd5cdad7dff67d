"""Bodies whose centre of mass can be moved from world to world.

MuJoCo compiles shortcuts in: where a body's inertial frame is the body's own it never looks at ``body_ipos``, a free
body's mass matrix is then a diagonal, and a geom or site at the centre of mass is placed by it. A moved ``body_ipos``
changes nothing then, or takes the geom along. Here such a body is compiled with its centre of mass elsewhere, which
leaves the shortcuts out, and the centre then written back. (``body_sameframe``, ``body_simple``, ``geom_sameframe`` in
https://mujoco.readthedocs.io/en/stable/APIreference/APItypes.html.) Replays with and without the shortcuts agree to
rounding.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import mujoco
import numpy as np

from onlinebayes.simulators.mujoco.model import compile_spec

ALIGNED = int(mujoco.mjtSameFrame.mjSAMEFRAME_BODY)
AT_CENTRE = int(mujoco.mjtSameFrame.mjSAMEFRAME_INERTIA)
NOT_SAME = int(mujoco.mjtSameFrame.mjSAMEFRAME_NONE)
ELSEWHERE = 0.1  # [m]; any place that the compiler does not take for the body's own


def with_movable_centres(
    spec: mujoco.MjSpec, model: mujoco.MjModel, bodies: Iterable[int], turned: Iterable[int] = ()
) -> mujoco.MjModel:
    """The compiled model without the shortcuts that keep ``body_ipos`` of these bodies from mattering.

    Args:
        spec: what the model was compiled from; not changed.
        model: the compiled model.
        bodies: ids of named bodies.
        turned: of those whose ``body_iquat`` is to matter, too.
    """
    turned = sorted(set(turned))
    bodies = sorted({*bodies, *turned})
    if aligned := [i for i in bodies if model.body_sameframe[i] == ALIGNED]:
        away = spec.copy()
        for i in aligned:
            body = away.body(model.body(i).name)
            own_inertial(away, body, model)
            body.ipos = model.body_ipos[i] + ELSEWHERE
        compiled = compile_spec(away)
        compiled.body_ipos[aligned] = model.body_ipos[aligned]
        mujoco.mj_setConst(compiled, mujoco.MjData(compiled))
        model = compiled
    for element in ("geom", "site"):
        frames = getattr(model, f"{element}_sameframe")
        mine = np.isin(getattr(model, f"{element}_bodyid"), bodies)
        frames[mine & (frames == AT_CENTRE)] = NOT_SAME
        frames[np.isin(getattr(model, f"{element}_bodyid"), turned)] = NOT_SAME
    model.body_sameframe[turned] = NOT_SAME
    return model


def own_inertial(spec: mujoco.MjSpec, body: mujoco.MjsBody, model: mujoco.MjModel) -> None:
    """Give a named body the inertial that it was compiled to, in place of one inferred from its geoms."""
    if body.explicitinertial and np.isnan(body.fullinertia[0]):
        return
    compiled = model.body(body.name)
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    body.explicitinertial = True
    body.fullinertia = np.full(6, math.nan)
    body.mass, body.inertia = float(compiled.mass[0]), compiled.inertia.copy()
    body.ipos, body.iquat = compiled.ipos.copy(), compiled.iquat.copy()
