"""Terms of an actuator: ``gainprm`` and ``biasprm`` of its own force, and the range within which it stays."""

from __future__ import annotations

import mujoco
import numpy as np

from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import ActuatorGain, ActuatorSaturation, BackEmf
from onlinebayes.simulators.mujoco.native.term import Arrays, NativeTerm

LINEAR_GAIN = (mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtGain.mjGAIN_AFFINE)
LINEAR_BIAS = (mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_AFFINE)
UNLIMITED = 1e15
"""Force range of an actuator that has none of its own: no finite motion reaches it [N, N m]."""


class Gain(NativeTerm[ActuatorGain]):
    """Gain and bias alike; limits of force act after them."""

    fields = ("actuator_gainprm", "actuator_biasprm")

    def edit(self, spec: mujoco.MjSpec, effect: ActuatorGain) -> None:
        """Refuse an actuator whose force is not linear in its gain and bias parameters (muscle, DC motor)."""
        actuator = spec.actuator(effect.target)
        if actuator.gaintype not in LINEAR_GAIN or actuator.biastype not in LINEAR_BIAS:
            raise BadInput(
                f"{effect.key}: the actuator's force is not linear in its parameters",
                "use a motor, a servo or a general actuator with affine gain and bias",
            )

    def write(self, model: mujoco.MjModel, fields: Arrays, effect: ActuatorGain, parameters: Arrays) -> None:
        """``gainprm``, ``biasprm`` times (1 + g)."""
        i = int(model.actuator(effect.target).id)
        factor = 1.0 + parameters["gain"][:, None]
        fields["actuator_gainprm"][:, i] *= factor
        fields["actuator_biasprm"][:, i] *= factor


class ForceRange(NativeTerm[ActuatorSaturation]):
    """The actuator's range of force, within its own."""

    fields = ("actuator_forcerange",)

    def edit(self, spec: mujoco.MjSpec, effect: ActuatorSaturation) -> None:
        """Give an actuator without limits some that are never reached, so that each world can have its own."""
        actuator = spec.actuator(effect.target)
        own = actuator.forcelimited == mujoco.mjtLimited.mjLIMITED_TRUE or (
            actuator.forcelimited == mujoco.mjtLimited.mjLIMITED_AUTO and np.any(actuator.forcerange != 0)
        )
        actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        if not own:
            actuator.forcerange = [-UNLIMITED, UNLIMITED]

    def write(self, model: mujoco.MjModel, fields: Arrays, effect: ActuatorSaturation, parameters: Arrays) -> None:
        """``actuator_forcerange`` cut to [-F, F] where F is below its upper bound."""
        limits = fields["actuator_forcerange"][:, int(model.actuator(effect.target).id)]
        bound = np.where(parameters["limit"] < effect.limit.high, parameters["limit"], np.inf)
        limits[:, 0] = np.maximum(limits[:, 0], -bound)
        limits[:, 1] = np.minimum(limits[:, 1], bound)


class VelocityBias(NativeTerm[BackEmf]):
    """The bias that goes with the actuator's velocity; for a servo it adds to kv."""

    fields = ("actuator_biasprm",)

    def edit(self, spec: mujoco.MjSpec, effect: BackEmf) -> None:
        """Make the bias affine; refuse an actuator whose bias is of another kind (muscle, DC motor)."""
        actuator = spec.actuator(effect.target)
        if actuator.biastype not in LINEAR_BIAS:
            raise BadInput(
                f"{effect.key}: the actuator's bias is not affine",
                "use a motor, a servo or a general actuator with affine bias",
            )
        if actuator.biastype == mujoco.mjtBias.mjBIAS_NONE:
            actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
            actuator.biasprm[:] = 0.0

    def write(self, model: mujoco.MjModel, fields: Arrays, effect: BackEmf, parameters: Arrays) -> None:
        """``actuator_biasprm[2] -= k``."""
        fields["actuator_biasprm"][:, int(model.actuator(effect.target).id), 2] -= parameters["constant"]
