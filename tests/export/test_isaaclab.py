"""The exported event term for Isaac Lab, on a robot that keeps what is written to it: Isaac Lab itself needs a GPU."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from onlinebayes.export import export
from tests.export.conftest import CORRELATION, MEAN, SD, alike, hypothesis, loaded, refined


class Robot:
    """An articulation with the methods that Isaac Lab 2.3 names so."""

    device = "cpu"
    joint_names, body_names, num_joints = ["elbow", "shoulder"], ["fore", "upper"], 2

    def __init__(self, worlds: int) -> None:
        self.kept: dict[str, torch.Tensor] = {}
        self.masses, self.worlds = torch.ones(worlds, 2), worlds
        self.root_physx_view = SimpleNamespace(get_masses=lambda: self.masses, set_masses=self._set_masses)
        servo = SimpleNamespace(joint_indices=[0], is_implicit_model=True)
        servo.stiffness, servo.damping = torch.zeros(worlds, 1), torch.zeros(worlds, 1)
        self.actuators = {"servo": servo}

    def _set_masses(self, masses: torch.Tensor, indices: torch.Tensor) -> None:
        self.masses[indices] = masses[indices]

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("write_joint_"):
            raise AttributeError(name)

        def write(value: torch.Tensor, *, joint_ids: list[int], env_ids: torch.Tensor) -> None:
            place = self.kept.setdefault(name, torch.full((self.worlds, 2), torch.nan))
            place[env_ids[:, None], joint_ids] = value

        return write


def test_each_world_gets_one_joint_draw(folder: Path, tmp_path: Path) -> None:
    torch.manual_seed(0)
    assert export(folder, "isaaclab", tmp_path / "out")[-1] == "worlds_isaaclab.py"
    module = loaded(tmp_path / "out" / "worlds_isaaclab.py")
    assert not module.LEFT_OUT
    robot = Robot(600)

    class Scene(dict):
        num_envs = 600

    module.joint_draws(SimpleNamespace(scene=Scene(robot=robot)), None, SimpleNamespace(name="robot"))
    friction = robot.kept["write_joint_friction_coefficient_to_sim"]
    assert torch.equal(friction[:, 1], robot.kept["write_joint_dynamic_friction_coefficient_to_sim"][:, 1])
    assert bool(friction[:, 0].isnan().all())
    damping = robot.kept["write_joint_viscous_friction_coefficient_to_sim"][:, 1]
    stiffness = robot.kept["write_joint_stiffness_to_sim"][:, 0]
    assert torch.equal(stiffness, robot.actuators["servo"].stiffness[:, 0])
    seen = torch.stack([robot.masses[:, 0], damping, stiffness, friction[:, 1]], 1).double().numpy()
    alike(seen, MEAN, SD, CORRELATION)
    assert bool((robot.masses[:, 1] == 1).all())
    some = torch.tensor([3, 5])
    before = robot.masses.clone()
    module.joint_draws(SimpleNamespace(scene=Scene(robot=robot)), some, SimpleNamespace(name="robot"))
    assert {*(robot.masses != before).any(1).nonzero()[:, 0].tolist()} <= {3, 5}


def test_what_has_no_place_there_is_said(tmp_path: Path) -> None:
    names = ("body.fore.mass", "joint.shoulder.damping", "actuator.bend.kp", "joint_stiffness@elbow.stiffness")
    effects = ["joint_stiffness@elbow"]
    told = hypothesis(
        effects,
        (*names, "joint_stiffness@elbow.springref"),
        (*MEAN[:3], 2.0, 0.1),
        (*SD[:3], 0.1, 0.01),
        np.eye(5).tolist(),
    )
    export(refined(tmp_path / "refined", (effects, told)), "isaaclab", tmp_path / "out")
    module = loaded(tmp_path / "out" / "worlds_isaaclab.py")
    assert any("jnt_stiffness of elbow" in what for what in module.LEFT_OUT)
    env = SimpleNamespace(scene=type("Scene", (dict,), {"num_envs": 2})(robot=Robot(2)))
    with pytest.warns(UserWarning, match="jnt_stiffness"):
        module.joint_draws(env, None, SimpleNamespace(name="robot"))
