"""The meaning of an actuator's command: the position or the speed of its joint, or something else."""

from __future__ import annotations

import mujoco


def servo_inputs(model: mujoco.MjModel) -> dict[str, str]:
    """``ctrl.<actuator>`` -> ``qpos`` for a ``<position>``, ``qvel`` for a ``<velocity>`` or ``<intvelocity>``.

    f = k (u - q) - d v is told a position, f = k (u - v) a speed; integrated first, the first is told a speed, too.
    """
    found = {}
    for i in range(model.nu):
        gain, (_, on_position, on_speed) = model.actuator_gainprm[i, 0], model.actuator_biasprm[i, :3]
        affine = model.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_AFFINE
        integrated = model.actuator_dyntype[i] == mujoco.mjtDyn.mjDYN_INTEGRATOR
        if not affine or gain == 0:
            continue
        if on_position == -gain:
            found[f"ctrl.{model.actuator(i).name}"] = "qvel" if integrated else "qpos"
        elif on_position == 0 and on_speed == -gain:
            found[f"ctrl.{model.actuator(i).name}"] = "qvel"
    return found
