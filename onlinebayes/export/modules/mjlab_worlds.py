"""Domain randomisation for mjlab, drawn from what was learnt of the machine; reads worlds.json beside it.

    from worlds_mjlab import EVENTS
    cfg.events |= EVENTS                                  # of a ManagerBasedRlEnvCfg whose robot is refined.xml

One event term draws all parameters together: each environment gets one of the 256 joint draws, so that correlations are
kept, which terms of their own (``dr.joint_damping`` ...) would lose. The constants that MuJoCo derives are written with
them. Effects that MuJoCo has no term for stand in LEFT_OUT (effect -> why): a warning names them. ACTUATORS holds what
belongs in the configuration of the robot's actuators. Written against mjlab 1.6.
"""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import mujoco
import torch
from mjlab.managers.event_manager import EventTermCfg, requires_model_fields
from mjlab.managers.scene_entity_config import SceneEntityCfg

WORLDS: dict[str, Any] = json.loads((Path(__file__).parent / "worlds.json").read_text(encoding="utf-8"))
DERIVED = (
    *("body_subtreemass", "body_invweight0", "dof_invweight0"),
    *("tendon_length0", "tendon_invweight0", "actuator_acc0"),
)
"""Derived constants that mujoco_warp has."""

CELLS: list[dict[str, Any]] = []
COLUMNS: list[int] = []
LEFT_OUT: dict[str, str] = dict(WORLDS["mujoco"]["left_out"])
for column, one in enumerate(WORLDS["mujoco"]["cells"]):
    if one["kind"] == "option" or "delay" in one["field"]:
        LEFT_OUT[one["field"]] = "which mjlab does not expand per world: refined.xml holds its mean"
    elif not one["derived"] or one["field"] in DERIVED:
        CELLS.append(one)
        COLUMNS.append(column)
VALUES: list[list[float]] = [[row[c] for c in COLUMNS] for row in WORLDS["mujoco"]["values"]]

ACTUATORS: dict[str, dict[str, int]] = WORLDS["actuators"]["delay_steps"]
"""Actuator -> delay_min_lag and delay_max_lag of its ActuatorCfg [physics timesteps]."""


@requires_model_fields(*dict.fromkeys(cell["field"] for cell in CELLS))
def joint_draws(env: Any, env_ids: torch.Tensor | None, asset_cfg: SceneEntityCfg | None = None) -> None:
    """Write one joint draw of all parameters into each of these environments.

    Args:
        env: a ManagerBasedRlEnv.
        env_ids: numbers of environments; all when None.
        asset_cfg: the robot in the scene, whose elements are called ``<its name>/<name>``; ``robot`` when None.

    Raises:
        KeyError: the scene has no element of a name.
    """
    if LEFT_OUT:
        warnings.warn("worlds without " + "; ".join(f"{what}, {why}" for what, why in LEFT_OUT.items()), stacklevel=2)
    robot = "robot" if asset_cfg is None else asset_cfg.name
    ids = torch.arange(env.num_envs, device=env.device) if env_ids is None else env_ids.to(env.device).long()
    number = torch.randint(len(VALUES), (len(ids),), device=env.device)
    values = torch.tensor(VALUES, device=env.device)[number]
    for column, cell in enumerate(CELLS):
        field = getattr(env.sim.model, cell["field"])
        row, *index = _index(env.sim.mj_model, cell, robot)
        field[(ids, torch.full_like(ids, row), *(torch.full_like(ids, k) for k in index))] = values[:, column].to(
            field.dtype
        )


def _index(model: mujoco.MjModel, cell: dict[str, Any], robot: str) -> tuple[int, ...]:
    """The index of a cell in its array, after the axis of the environments."""
    if cell["name"] is None:
        raise KeyError(f"{cell['kind']} {cell['id']} of refined.xml has no name: give it one and refine again")
    number = mujoco.mj_name2id(
        model, getattr(mujoco.mjtObj, f"mjOBJ_{cell['kind'].upper()}"), f"{robot}/{cell['name']}"
    )
    if number < 0:
        raise KeyError(f"the scene has no {cell['kind']} '{robot}/{cell['name']}'")
    row = int(number)
    if cell["field"].startswith("dof_"):
        row = int(model.jnt_dofadr[number])
    elif cell["field"].startswith("qpos"):
        row = int(model.jnt_qposadr[number])
    return (row + cell["row"], *cell["index"])


EVENTS = {"worlds": EventTermCfg(func=joint_draws, mode="startup", params={})}
"""For ``events`` of the environment's configuration; mode ``"reset"`` draws anew in each episode."""
