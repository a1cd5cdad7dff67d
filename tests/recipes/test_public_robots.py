"""Public arms: a posture is a task like any other, and the draft of each arm's log has no line left to write."""

from __future__ import annotations

from pathlib import Path

import pytest
from torchrl.envs.utils import check_env_specs

from onlinebayes.problems import load_problem
from onlinebayes.problems.drafting import draft
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.simulators.mujoco import MujocoSimulator
from recipes.studies.public_robots.posture import Posture
from recipes.studies.public_robots.robots import ROBOTS, write_log

ARM = """<mujoco><worldbody><body><joint name="a" axis="0 1 0" damping="1"/><geom size=".1"/>
<body pos=".3 0 0"><joint name="b" axis="0 1 0" damping="1"/><geom size=".1"/></body></body></worldbody>
<actuator><position joint="a" kp="50"/><position joint="b" kp="50"/></actuator></mujoco>"""


@pytest.mark.parametrize("speeds", [True, False])
def test_a_posture_is_an_environment_of_any_arm(speeds: bool) -> None:
    env = SimulatorEnv(MujocoSimulator(ARM, worlds=3, dt=0.02, threads=1), Posture((0.1, -0.2), speeds))
    check_env_specs(env)
    assert env.rollout(5)["next", "reward"].shape == (3, 5, 1)


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_the_draft_of_a_public_arm_loads_as_it_is(name: str, tmp_path: Path) -> None:
    robot = ROBOTS[name]
    robot.write(tmp_path)
    write_log(robot, robot.write_machine(tmp_path), tmp_path / "log.csv", 0)
    made = draft(tmp_path / robot.model, [tmp_path / "log.csv"], tmp_path / "draft.toml")
    assert (dict(made.missing), made.questions, made.unused) == ({}, (), ())
    (tmp_path / "draft.toml").write_text(made.text, encoding="utf-8")
    assert len(load_problem(tmp_path / "draft.toml").simulator.commands) == len(robot.home)
