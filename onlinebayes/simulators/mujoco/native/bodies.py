"""Terms of bodies and of what pulls on all of them: ``body_mass``, ``body_ipos``, ``opt.gravity``."""

from __future__ import annotations

import mujoco
import numpy as np

from onlinebayes.simulators.effects import ComOffset, GravityTilt, Payload
from onlinebayes.simulators.mujoco.native.term import Arrays, NativeTerm


class PointMass(NativeTerm[Payload]):
    """More mass of the body, or of a welded body at the site, which also moves the centre."""

    fields = ("body_mass",)

    def edit(self, spec: mujoco.MjSpec, effect: Payload) -> None:
        """A welded body at the site, without mass until :meth:`write` gives it one."""
        if spec.body(effect.target) is not None:
            return
        # Not fused with its parent, which would make it nameless.
        spec.compiler.fusestatic = False
        site = spec.site(effect.target)
        place = spec.copy().compile().site(effect.target).pos
        carried = site.parent.add_body(name=effect.key, pos=place, ipos=np.zeros(3), mass=0.0, inertia=np.zeros(3))
        carried.explicitinertial = True

    def write(self, model: mujoco.MjModel, fields: Arrays, effect: Payload, parameters: Arrays) -> None:
        """``body_mass += dm``, of the body or of the one at the site."""
        bodies = {model.body(k).name for k in range(model.nbody)}
        carrier = effect.target if effect.target in bodies else effect.key
        fields["body_mass"][:, int(model.body(carrier).id)] += parameters["mass"]


class CentreOfMass(NativeTerm[ComOffset]):
    """The place of the body's inertial frame."""

    fields = ("body_ipos",)

    def write(self, model: mujoco.MjModel, fields: Arrays, effect: ComOffset, parameters: Arrays) -> None:
        """``body_ipos += d``."""
        i = int(model.body(effect.element).id)
        for axis, offset in parameters.items():
            fields["body_ipos"][:, i, effect.axes.index(axis)] += offset


class Gravity(NativeTerm[GravityTilt]):
    """The world's gravity."""

    fields = ("opt.gravity",)

    def write(self, model: mujoco.MjModel, fields: Arrays, effect: GravityTilt, parameters: Arrays) -> None:
        """``opt.gravity`` turned."""
        gravity = fields["opt.gravity"]
        gravity[:] = effect.turned(gravity, parameters)
