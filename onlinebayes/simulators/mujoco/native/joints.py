"""Terms at a slide or hinge joint: numbers of the joint itself, springs, and a force without a command.

MuJoCo's springs are -(k0 + k1 abs(x) + k2 x^2) x with x the distance from rest, for joints as for tendons. A cubic one
has a tendon to itself, because a joint has one rest position for all its terms: two cubics about different centres are
not one cubic, so the joint's own spring could not stay what it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import ConstantLoad, CubicStiffness, Effect, JointStiffness
from onlinebayes.simulators.mujoco.native.term import Arrays, NativeTerm


@dataclass(frozen=True)
class JointField(NativeTerm[Effect]):
    """A number of the joint's degree of freedom that grows by the effect's parameter.

    Args:
        fields: the one field.
        column: of that field, where it has several; MuJoCo's damping is -(d + p0 abs(v) + p1 v^2) v.
    """

    fields: tuple[str]
    column: tuple[int, ...] = ()

    def write(self, model: mujoco.MjModel, fields: Arrays, effect: Effect, parameters: Arrays) -> None:
        """``field += parameter``."""
        place: tuple[int | slice, ...] = (slice(None), int(model.joint(effect.target).dofadr[0]), *self.column)
        fields[self.fields[0]][place] += parameters[effect.magnitude]


class Spring(NativeTerm[JointStiffness]):
    """The joint's spring, of which there is one.

    Two springs at one joint are one: k1 (q - q1) + k2 (q - q2) = (k1 + k2) (q - (k1 q1 + k2 q2) / (k1 + k2)).
    """

    fields = ("jnt_stiffness", "qpos_spring")

    def edit(self, spec: mujoco.MjSpec, effect: JointStiffness) -> None:
        """Refuse a joint whose own spring is not linear: its rest position cannot be shared."""
        if any(spec.joint(effect.target).stiffness[1:]):
            problem = f"{effect.key}: the joint's own spring is nonlinear"
            raise BadInput(problem, "free joint.<name>.stiffness[i] instead")

    def write(self, model: mujoco.MjModel, fields: Arrays, effect: JointStiffness, parameters: Arrays) -> None:
        """``jnt_stiffness += k``, and ``qpos_spring`` where both springs together rest."""
        joint = model.joint(effect.target)
        q, j = int(joint.qposadr[0]), int(joint.id)
        k, present = parameters["stiffness"], fields["jnt_stiffness"][:, j].copy()
        rest, on = fields["qpos_spring"][:, q], k > 0
        fields["jnt_stiffness"][:, j] += k
        rest[on] = (present[on] * rest[on] + k[on] * parameters["springref"][on]) / (present[on] + k[on])


class CubicSpring(NativeTerm[CubicStiffness]):
    """A tendon, named like the effect, whose length is q."""

    fields = ("tendon_stiffnesspoly", "tendon_lengthspring")

    def edit(self, spec: mujoco.MjSpec, effect: CubicStiffness) -> None:
        """Append the tendon."""
        tendon = spec.add_tendon()
        tendon.name = effect.key
        tendon.wrap_joint(effect.target, 1.0)
        tendon.springlength = [0.0, 0.0]

    def write(self, model: mujoco.MjModel, fields: Arrays, effect: CubicStiffness, parameters: Arrays) -> None:
        """``tendon_stiffnesspoly[1] = k3`` and both ends of ``tendon_lengthspring`` = q0."""
        i = int(model.tendon(effect.key).id)
        rest = parameters["springref"]
        fields["tendon_stiffnesspoly"][:, i, 1] = parameters["stiffness3"]
        # In MJCF a springlength of exactly -1 means "the length at qpos0".
        fields["tendon_lengthspring"][:, i] = np.where(rest == -1.0, np.nextafter(-1.0, 0.0), rest)[:, None]


class Load(NativeTerm[ConstantLoad]):
    """An actuator, named like the effect, that has a bias and no input; it is no command of the simulator."""

    fields = ("actuator_biasprm",)

    def edit(self, spec: mujoco.MjSpec, effect: ConstantLoad) -> None:
        """Append the actuator."""
        add_load_actuator(spec, effect.key, effect.target)

    def write(self, model: mujoco.MjModel, fields: Arrays, effect: ConstantLoad, parameters: Arrays) -> None:
        """``actuator_biasprm[0] = L``."""
        fields["actuator_biasprm"][:, int(model.actuator(effect.key).id), 0] = parameters["load"]


def add_load_actuator(spec: mujoco.MjSpec, name: str, joint: str) -> None:
    """Append an actuator whose force is ``biasprm[0]`` and nothing else."""
    actuator = spec.add_actuator()
    actuator.name, actuator.target = name, joint
    actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    actuator.gainprm[0] = 0.0
