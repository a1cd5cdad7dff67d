"""The force that an actuator of a slide or hinge joint gives, as MuJoCo computes it, without running the engine.

    f = clip((g0 + g1 l + g2 l') u + b0 + b1 l + b2 l'),   l = gear q,  l' = gear v,   on the joint: gear f

(MuJoCo: Computation, "Actuation model"; fixed and affine gains and biases, no activation.) The engine's own value is
that of the timestep before, which is no part of the state; effects need the one of the timestep to come.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Servo

_GAINS = (int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtGain.mjGAIN_AFFINE))
_BIASES = (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE))
_SCALAR = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
FIELDS = ("actuator_gear", "actuator_gainprm", "actuator_biasprm", "actuator_ctrlrange", "actuator_forcerange")
"""Fields of the model that the force depends on; they may differ between worlds."""


@dataclass(frozen=True)
class JointActuator:
    """One actuator that acts on a joint.

    Args:
        actuator: its id.
        column: of its command among the simulator's.
        ctrl: its place in ``ctrl``.
        joint: id of the joint.
        affine_gain, affine_bias: whether g1, g2 and b0, b1, b2 count.
        ctrl_limited, force_limited: which ranges count.
    """

    actuator: int
    column: int
    ctrl: int
    joint: int
    affine_gain: bool
    affine_bias: bool
    ctrl_limited: bool
    force_limited: bool

    @classmethod
    def of(cls, model: mujoco.MjModel, actuator: int, column: int, ctrl: int) -> JointActuator | None:
        """The actuator, or None where it acts through a tendon, a site or a body."""
        if int(model.actuator_trntype[actuator]) not in _JOINT:
            return None
        return cls(
            actuator,
            column,
            ctrl,
            int(model.actuator_trnid[actuator, 0]),
            bool(model.actuator_gaintype[actuator] == int(mujoco.mjtGain.mjGAIN_AFFINE)),
            bool(model.actuator_biastype[actuator] == int(mujoco.mjtBias.mjBIAS_AFFINE)),
            bool(model.actuator_ctrllimited[actuator]),
            bool(model.actuator_forcelimited[actuator]),
        )

    def follows(self, model: mujoco.MjModel) -> bool:
        """Check whether the force is the module's equation, on a slide or a hinge: no muscle, activation or delay."""
        i = self.actuator
        linear = int(model.actuator_gaintype[i]) in _GAINS and int(model.actuator_biastype[i]) in _BIASES
        prompt = model.actuator_dyntype[i] == int(mujoco.mjtDyn.mjDYN_NONE) and not model.actuator_delay[i]
        return bool(linear and prompt and int(model.jnt_type[self.joint]) in _SCALAR)

    def check(self, model: mujoco.MjModel, key: str) -> None:
        """Raise :class:`BadInput` where the force is not the module's equation; see :meth:`follows`."""
        if not self.follows(model):
            raise BadInput(
                f"{key}: the force of actuator '{model.actuator(self.actuator).name}' is not linear in command "
                "and motion",
                "use a motor, a servo or a general actuator with affine gain and bias, no activation and no delay",
            )

    def gear(self, fields: Mapping[str, Tensor]) -> Float[Tensor, "*batch"]:
        """Force on the joint per force of the actuator."""
        return fields["actuator_gear"][..., self.actuator, 0]

    def force(
        self, fields: Mapping[str, Tensor], ctrl: Tensor, q: Tensor, v: Tensor, on: Tensor
    ) -> Float[Tensor, "*batch"]:
        """f in each world, 0 while the actuator is off.

        Args:
            fields: :data:`FIELDS`, each with N worlds or one for all.
            ctrl: what the engine will receive (N, nu).
            q, v: of the joint (N,).
            on: which actuators are on (N, U).

        With K rows of each world at once ctrl, q, v and on are (N, K, ...), the fields (N, 1, ...).
        """
        force = self._unlimited(fields, ctrl, q, v)
        if self.force_limited:
            force = _clip(force, fields["actuator_forcerange"][..., self.actuator, :])
        return force * on[..., self.column]

    def servo(
        self, fields: Mapping[str, Tensor], ctrl: Tensor, q: Tensor, v: Tensor, on: Tensor, whole: bool = True
    ) -> Servo:
        """Its law on its joint, or that of its own force before the gear; arguments as :meth:`force`.

        Args:
            whole: whether forces are those on the joint.
        """
        i, ratio, works = self.actuator, self.gear(fields), on[..., self.column] > 0
        gear = ratio if whole else torch.ones_like(ratio)
        bias, force = fields["actuator_biasprm"][..., i, :], self._unlimited(fields, ctrl, q, v)
        # As many rows as worlds, though the fields may be one for all.
        low, high = torch.full_like(force, -math.inf), torch.full_like(force, math.inf)
        if self.force_limited:
            ends = (gear[..., None] * fields["actuator_forcerange"][..., i, :]).sort(dim=-1).values
            low, high = ends[..., 0].expand_as(force), ends[..., 1].expand_as(force)
        none = torch.zeros_like(force)
        stiffness, damping = ((-gear * ratio * bias[..., k]).expand_as(force) for k in (1, 2))
        return Servo(gear * force, stiffness, damping, torch.where(works, low, none), torch.where(works, high, none))

    def _unlimited(self, fields: Mapping[str, Tensor], ctrl: Tensor, q: Tensor, v: Tensor) -> Float[Tensor, "*batch"]:
        """f before its limits."""
        i = self.actuator
        gear, gain, bias = (
            self.gear(fields),
            fields["actuator_gainprm"][..., i, :],
            fields["actuator_biasprm"][..., i, :],
        )
        u = ctrl[..., self.ctrl]
        if self.ctrl_limited:
            u = _clip(u, fields["actuator_ctrlrange"][..., i, :])
        length, speed = gear * q, gear * v
        slope = gain[..., 0]
        if self.affine_gain:
            slope = slope + gain[..., 1] * length + gain[..., 2] * speed
        force = slope * u
        if self.affine_bias:
            force = force + bias[..., 0] + bias[..., 1] * length + bias[..., 2] * speed
        return force


def _clip(x: Tensor, bounds: Tensor) -> Tensor:
    return torch.minimum(torch.maximum(x, bounds[..., 0]), bounds[..., 1])
