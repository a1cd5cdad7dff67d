"""A program for a Python that has mjlab: an environment of an exported robot, and the parameters of its worlds.

    python mjlab_robot.py FOLDER            prints JSON: rows of mass, damping, kp and friction, after one step

It imports nothing of onlinebayes, for mjlab 1.6 asks for another MuJoCo.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

WORLDS = 16


def environment(out: Path, events: dict[str, Any]) -> Any:
    """The exported robot alone, with an action at the shoulder."""
    import mujoco
    from mjlab.actuator.xml_actuator import XmlActuatorCfg
    from mjlab.entity import EntityArticulationInfoCfg, EntityCfg
    from mjlab.envs import ManagerBasedRlEnv, ManagerBasedRlEnvCfg
    from mjlab.envs.mdp import joint_pos_rel, time_out
    from mjlab.envs.mdp.actions import JointEffortActionCfg
    from mjlab.managers.observation_manager import ObservationGroupCfg, ObservationTermCfg
    from mjlab.managers.termination_manager import TerminationTermCfg
    from mjlab.scene import SceneCfg

    robot = EntityCfg(
        spec_fn=lambda: mujoco.MjSpec.from_file(str(out / "refined.xml")),
        articulation=EntityArticulationInfoCfg(actuators=(XmlActuatorCfg(target_names_expr=("shoulder",)),)),
    )
    cfg = ManagerBasedRlEnvCfg(
        scene=SceneCfg(num_envs=WORLDS, entities={"robot": robot}),
        decimation=1,
        episode_length_s=1.0,
        observations={"actor": ObservationGroupCfg(terms={"q": ObservationTermCfg(func=joint_pos_rel)})},
        actions={"lift": JointEffortActionCfg(entity_name="robot", actuator_names=("shoulder",))},
        terminations={"end": TerminationTermCfg(func=time_out, time_out=True)},
        events=events,
    )
    return ManagerBasedRlEnv(cfg, device="cpu")


def main(out: Path) -> None:
    """Make it, step it, print."""
    import torch

    sys.path.insert(0, str(out))
    import worlds_mjlab  # type: ignore[import-not-found]

    env = environment(out, worlds_mjlab.EVENTS)
    env.step(torch.ones(WORLDS, 1))
    model, names = env.sim.model, env.sim.mj_model
    body, joint = names.body("robot/fore").id, int(names.joint("robot/shoulder").dofadr[0])
    gain = [names.actuator(i).name for i in range(names.nu)].index("robot/bend")
    parts = (model.body_mass[:, body], model.dof_damping[:, joint], model.actuator_gainprm[:, gain, 0])
    seen = torch.stack([torch.as_tensor(part) for part in (*parts, model.dof_frictionloss[:, joint])], 1)
    subtree = torch.as_tensor(model.body_subtreemass[:, names.body("robot/upper").id])
    print(json.dumps({"seen": seen.tolist(), "subtree": subtree.tolist()}))


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
