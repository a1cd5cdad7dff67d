"""MuJoCo's friction constraint made hard enough to stick: ``dof_solimp`` and ``dof_solref`` of the joints that rub.

MuJoCo's friction constraint is soft: it asks for the acceleration -b v, where Coulomb asks for v = 0 at once, so that
under another torque tau it changes sign while v is still tau / (I b): the friction acts as -F sign(v(t + 1 / b)). With
the defaults 1 / b is 10 ms, which a fit takes for a spring. A joint that should stick creeps at

    v = (1 - d) / d * (tau / I) / b,                d the constraint's impedance,

with the defaults (d = .9) 1e-3 s times the acceleration that the load would cause, which a fit takes for viscous slip.
Dry friction therefore sets ``solimp_friction`` to MuJoCo's largest impedance, .9999, and ``solref_friction`` to the
largest b that the integrator bears: 1 / timestep for a first-order one (v is zero after one step), 2 / timestep for
RK4 (its limit is 2.8). A simulator asked for soft friction leaves the model's own values.
"""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Bool

from onlinebayes.simulators.mujoco.native.term import Arrays

SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)
"""``solimp_friction`` under dry friction: constant impedance d = .9999, the largest that MuJoCo takes."""
RATE = {mujoco.mjtIntegrator.mjINT_RK4: 2.0}
"""b times the timestep, by integrator; 1 for the others."""
SOFTNESS = ("dof_solimp", "dof_solref")
"""The fields that say how soft the constraint is."""
FIELDS = ("dof_frictionloss", *SOFTNESS)
"""The fields that dry friction sets."""


def harden(model: mujoco.MjModel, fields: Arrays, joint: str, where: Bool[np.ndarray, " N"]) -> None:
    """Make the joint's friction stick in the worlds ``where`` it rubs; elsewhere nothing changes."""
    dof = int(model.joint(joint).dofadr[0])
    fields["dof_solimp"][where, dof] = SOLIMP
    # Negative values are stiffness (without meaning for friction) and b, which mjModel divides by the impedance.
    rate = RATE.get(mujoco.mjtIntegrator(model.opt.integrator), 1.0) / model.opt.timestep
    fields["dof_solref"][where, dof] = (-1.0, -rate * SOLIMP[0])
