"""The meaning of an actuator's command: the position or the speed of its joint, or something else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import mujoco

ON_JOINTS = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)


@dataclass(frozen=True)
class Input:
    """What an actuator is told.

    Args:
        told: ``qpos`` for a ``<position>``, ``qvel`` for a ``<velocity>`` or ``<intvelocity>``, ``other`` for another
            feedback on position, whose command has a unit of its own; empty for a force, a voltage, what nobody knows.
        joint: that it acts on; empty where it is none (a tendon, a site).
    """

    told: Literal["qpos", "qvel", "other", ""] = ""
    joint: str = ""

    @property
    def takes_pushes(self) -> bool:
        """False for a servo: a torque, a current or a voltage is no command of it."""
        return not self.told


def actuator_inputs(model: mujoco.MjModel) -> dict[str, Input]:
    """``ctrl.<actuator>`` -> what it is told.

    f = k (u - q) - d v is told a position, f = k (u - v) a speed; integrated first, the first is told a speed, too.
    """
    found = {}
    for i in range(model.nu):
        on_joint = mujoco.mjtTrn(model.actuator_trntype[i]) in ON_JOINTS
        joint = model.joint(int(model.actuator_trnid[i, 0])).name if on_joint else ""
        found[f"ctrl.{model.actuator(i).name}"] = Input(_told(model, i), joint)
    return found


def _told(model: mujoco.MjModel, i: int) -> Literal["qpos", "qvel", "other", ""]:
    gain, (_, on_position, on_speed) = model.actuator_gainprm[i, 0], model.actuator_biasprm[i, :3]
    if model.actuator_biastype[i] != mujoco.mjtBias.mjBIAS_AFFINE or gain == 0:
        return ""
    if on_position == -gain:
        return "qvel" if model.actuator_dyntype[i] == mujoco.mjtDyn.mjDYN_INTEGRATOR else "qpos"
    if on_position == 0:
        return "qvel" if on_speed == -gain else ""
    return "other"
