"""Domain randomisation for Isaac Lab, drawn from what was learnt of the machine; reads worlds.json beside it.

    from worlds_isaaclab import joint_draws
    worlds = EventTerm(func=joint_draws, mode="startup", params={"asset_cfg": SceneEntityCfg("robot")})

One event term draws all parameters together: each environment gets one of the 256 joint draws, so that correlations are
kept; Isaac Lab's own terms (``randomize_joint_parameters`` ...) draw each one alone and lose them. The robot has the
names of joints and bodies of the MJCF. Written against Isaac Lab 2.3 on Isaac Sim 5, where joint friction is an effort
[N m, N], and not run there by onlinebayes: try it in one environment first.

    MuJoCo field               here
    dof_damping                joint viscous friction
    dof_frictionloss           joint friction, static and dynamic
    dof_armature               joint armature
    body_mass                  mass; the inertia stays, as in MuJoCo
    actuator gain, bias        stiffness and damping of a position servo's joint

What has no place here stands in LEFT_OUT (effect or field -> why): a warning names it. ACTUATORS holds the delays of
actuators, for ``min_delay`` and ``max_delay`` of DelayedPDActuatorCfg.
"""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import torch

WORLDS: dict[str, Any] = json.loads((Path(__file__).parent / "worlds.json").read_text(encoding="utf-8"))
SERVOS: dict[str, str] = WORLDS["actuators"]["servo_joints"]
"""Position servo -> its joint."""

ACTUATORS: dict[str, dict[str, int]] = WORLDS["actuators"]["delay_steps"]
"""Actuator -> min and max of its delay [physics timesteps]."""

PLACES = {
    ("dof_damping", ()): "viscous_friction",
    ("dof_frictionloss", ()): "friction",
    ("dof_armature", ()): "armature",
    ("body_mass", ()): "mass",
    ("actuator_gainprm", (0,)): "stiffness",
    ("actuator_biasprm", (2,)): "damping",
}
FOLLOWS = {("actuator_biasprm", (1,))}
"""Of a servo, the gain once more."""


def _table() -> tuple[dict[tuple[str, str], list[float]], dict[str, str]]:
    """(place, name of joint or body) -> its value in every draw; and what is left out."""
    found: dict[tuple[str, str], list[float]] = {}
    left_out: dict[str, str] = dict(WORLDS["mujoco"]["left_out"])
    for column, cell in enumerate(WORLDS["mujoco"]["cells"]):
        key = (cell["field"], tuple(cell["index"]))
        name = SERVOS.get(cell["name"]) if cell["kind"] == "actuator" else cell["name"]
        if cell["derived"] or (key in FOLLOWS and name):
            continue
        if key not in PLACES or name is None or cell["row"]:
            left_out[f"{cell['field']} of {cell['name']}"] = "which Isaac Lab has no place for"
            continue
        sign = -1.0 if key[0] == "actuator_biasprm" else 1.0
        found[PLACES[key], name] = [sign * row[column] for row in WORLDS["mujoco"]["values"]]
    return found, left_out


TABLE, LEFT_OUT = _table()


def joint_draws(env: Any, env_ids: torch.Tensor | None, asset_cfg: Any) -> None:
    """Write one joint draw of all parameters into each of these environments.

    Args:
        env: a ManagerBasedEnv.
        env_ids: numbers of environments; all when None.
        asset_cfg: the robot, a SceneEntityCfg.
    """
    if LEFT_OUT:
        warnings.warn("worlds without " + "; ".join(f"{what}, {why}" for what, why in LEFT_OUT.items()), stacklevel=2)
    robot = env.scene[asset_cfg.name]
    ids = torch.arange(env.scene.num_envs, device=robot.device) if env_ids is None else env_ids
    number = torch.randint(len(WORLDS["draws"]), (len(ids),))
    masses = robot.root_physx_view.get_masses().clone() if any(place == "mass" for place, _ in TABLE) else None
    for (place, name), values in TABLE.items():
        value = torch.tensor(values)[number]
        if place == "mass" and masses is not None:
            masses[ids.cpu(), robot.body_names.index(name)] = value.to(masses.dtype)
            continue
        _write_joint(robot, place, value.to(robot.device)[:, None], robot.joint_names.index(name), ids)
    if masses is not None:
        robot.root_physx_view.set_masses(masses, ids.cpu())


def _write_joint(robot: Any, place: str, value: torch.Tensor, joint: int, ids: torch.Tensor) -> None:
    """Write one quantity (n, 1) of one joint in n environments."""
    where = {"joint_ids": [joint], "env_ids": ids}
    if place == "viscous_friction":
        robot.write_joint_viscous_friction_coefficient_to_sim(value, **where)
    elif place == "friction":
        robot.write_joint_friction_coefficient_to_sim(value, **where)
        robot.write_joint_dynamic_friction_coefficient_to_sim(value, **where)
    elif place == "armature":
        robot.write_joint_armature_to_sim(value, **where)
    else:
        _write_gain(robot, place, value, joint, ids)


def _write_gain(robot: Any, place: str, value: torch.Tensor, joint: int, ids: torch.Tensor) -> None:
    """Write a servo's gain into its actuator's model, and into the joint's drive where that is what drives it."""
    for actuator in robot.actuators.values():
        joints = (
            list(range(robot.num_joints)) if actuator.joint_indices == slice(None) else list(actuator.joint_indices)
        )
        if joint in [int(j) for j in joints]:
            getattr(actuator, place)[ids, [int(j) for j in joints].index(joint)] = value[:, 0]
            if actuator.is_implicit_model:
                getattr(robot, f"write_joint_{place}_to_sim")(value, joint_ids=[joint], env_ids=ids)
