"""Dry friction as ``dof_frictionloss``, made hard (see :mod:`.sticking`) only in worlds where an effect adds some.

Friction that differs by direction is the same and a constant force together, as its law is.
"""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

from onlinebayes.simulators.effects import AsymmetricFriction, DryFriction
from onlinebayes.simulators.mujoco.native.joints import add_load_actuator
from onlinebayes.simulators.mujoco.native.sticking import FIELDS, harden
from onlinebayes.simulators.mujoco.native.term import Arrays, NativeTerm


class Friction(NativeTerm[DryFriction]):
    """The joint's frictionloss."""

    fields = FIELDS

    def write(self, model: mujoco.MjModel, fields: Arrays, effect: DryFriction, parameters: Arrays) -> None:
        """See :func:`add_friction`."""
        add_friction(model, fields, effect.target, parameters["frictionloss"])


class FrictionOfTwoSizes(NativeTerm[AsymmetricFriction]):
    """The joint's frictionloss F, and an actuator for L, named like the effect; it is no command of the simulator."""

    fields = (*FIELDS, "actuator_biasprm")

    def edit(self, spec: mujoco.MjSpec, effect: AsymmetricFriction) -> None:
        """Append the actuator."""
        add_load_actuator(spec, effect.key, effect.target)

    def write(self, model: mujoco.MjModel, fields: Arrays, effect: AsymmetricFriction, parameters: Arrays) -> None:
        """``dof_frictionloss += F``, and ``actuator_biasprm[0] = L``."""
        plus, minus = parameters["frictionloss_positive"], parameters["frictionloss_negative"]
        add_friction(model, fields, effect.target, (plus + minus) / 2)
        fields["actuator_biasprm"][:, int(model.actuator(effect.key).id), 0] = (minus - plus) / 2


def add_friction(model: mujoco.MjModel, fields: Arrays, joint: str, bound: Float[np.ndarray, " N"]) -> None:
    """``dof_frictionloss += F`` [N, N m], made hard where F > 0."""
    fields["dof_frictionloss"][:, int(model.joint(joint).dofadr[0])] += bound
    harden(model, fields, joint, bound > 0)
