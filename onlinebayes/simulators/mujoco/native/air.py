"""Drag of bodies in a fluid, carried by MuJoCo's fluid model through a sphere of its own that touches nothing.

    f = -c abs(v - w) (v - w),      v of the body's centre of mass, w the wind (``opt.wind``)

The ellipsoid model gives a sphere of radius r and blunt drag coefficient C, all other coefficients zero, the force
-rho C pi r^2 abs(v - w) (v - w) at its centre (MuJoCo: Computation, "Fluid forces"). So c = rho C pi r^2, evaluated
with the engine's own velocities, at every stage of RK4 and implicitly where the integrator is.

A density above zero also drags every body without such a sphere, by the box of its inertia. rho is therefore as small
as MuJoCo still writes to a file, a quadrillionth of the air's, and C as large as c asks for. A model with a fluid of
its own is refused: the box of a body with a sphere has no drag.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import AirDrag, Wind
from onlinebayes.simulators.effects.base import split_axis
from onlinebayes.simulators.mujoco.native.term import Arrays, NativeTerm

FIELDS = ("geom_fluid", "geom_pos", "opt.density")
"""The fields that drag sets."""
RADIUS, DENSITY = 0.1, 1e-15  # [m], [kg/m3]
ACTIVE, BLUNT = 0, 1  # columns of geom_fluid


@dataclass(frozen=True)
class Drag(NativeTerm[AirDrag | Wind]):
    """Drag, in a fluid that moves where the effect has a wind, which is one for all bodies with drag."""

    fields: tuple[str, ...] = FIELDS
    excludes = ("option.density", "option.viscosity")  # they would make a fluid of the model's own

    def edit(self, spec: mujoco.MjSpec, effect: AirDrag | Wind) -> None:
        """See :func:`add_spheres`."""
        add_spheres(spec, effect.key, effect.element)

    def write(self, model: mujoco.MjModel, fields: Arrays, effect: AirDrag | Wind, parameters: Arrays) -> None:
        """See :func:`write_drag`; ``opt.wind += w``."""
        write_drag(model, fields, effect.key, parameters["drag"])
        axis = split_axis(effect.target, effect.axes)[1]
        for name in parameters.keys() - {"drag"}:
            fields["opt.wind"][:, effect.axes.index(axis or name[-1])] += parameters[name]


def add_spheres(spec: mujoco.MjSpec, key: str, element: str) -> None:
    """Give a body, or all of them for ``"world"``, the sphere of the effect ``key``: massless, invisible, untouched.

    Raises:
        BadInput: the model has a fluid of its own.
    """
    if spec.option.density > 0 or spec.option.viscosity > 0:
        raise BadInput(f"{key}: the model has a fluid of its own", "free option.density or option.wind[0] instead")
    for k, body in enumerate(spec.bodies[1:] if element == "world" else [spec.body(element)]):
        geom = body.add_geom(name=f"{key}[{k}]", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[RADIUS, 0, 0], mass=0)
        geom.contype, geom.conaffinity, geom.group, geom.rgba = 0, 0, 5, [0, 0, 0, 0]
        geom.fluid_ellipsoid, geom.fluid_coefs = 1, [0, 0, 0, 0, 0]
        # Off the body's frames, or MuJoCo would take its place for theirs whatever geom_pos says.
        geom.pos = [RADIUS, 0, 0]


def write_drag(model: mujoco.MjModel, fields: Arrays, key: str, drag: Float[np.ndarray, " N"]) -> None:
    """``geom_fluid`` of the effect's spheres at their bodies' centres of mass; c of the largest body [N s2/m2].

    The others' are less by the square of their size, as areas are; what does not move has none.
    """
    spheres = [i for i in range(model.ngeom) if model.geom(i).name.startswith(f"{key}[")]
    bodies = [int(model.geom_bodyid[i]) for i in spheres]
    sizes = np.array([body_size(model, b) if model.body_weldid[b] else 0.0 for b in bodies])
    for sphere, body, share in zip(spheres, bodies, (sizes / sizes.max()) ** 2, strict=True):
        fields["geom_pos"][:, sphere] = model.body_ipos[body]
        # Without drag the sphere is off, and the body what it is without it in air that others have made.
        fields["geom_fluid"][:, sphere, ACTIVE] = drag > 0
        fields["geom_fluid"][:, sphere, BLUNT] = share * drag / (DENSITY * math.pi * RADIUS**2)
    density = fields["opt.density"]
    density[...] = np.where((drag > 0).reshape(density.shape), DENSITY, density)


def body_size(model: mujoco.MjModel, body: int) -> float:
    """Half the diagonal of the box with a body's inertia [m]; 0 without mass."""
    mass, trace = float(model.body_mass[body]), float(model.body_inertia[body].sum())
    # A box of sides 2a, 2b, 2c has the trace 2 m (a^2 + b^2 + c^2) / 3.
    return max(math.sqrt(1.5 * trace / mass), 1e-6) if mass > 0 else 0.0
