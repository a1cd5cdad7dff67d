"""A gripper that the log knows nothing of is welded, and the draft loads; a column that could be its own is asked."""

from __future__ import annotations

import tomllib
from pathlib import Path

from onlinebayes.problems import load_problem
from tests.problems.test_surroundings import drafted

FINGERS = """<body name="{0}" pos=".2 {1} 0"><joint name="{0}" type="slide" axis="0 1 0" range="0 .04" damping="1"/>
<geom size=".02" mass=".1"/></body>"""
PASSIVE = (
    '<body name="pad" pos=".2 0 .1"><joint name="pad" axis="0 1 0" damping=".1"/><geom size=".01" mass=".05"/></body>'
)
ARM = """<mujoco><worldbody><body name="arm" pos="0 0 1"><joint name="arm" axis="0 1 0" damping="1"/>
<geom type="capsule" fromto="0 0 0 .2 0 0" size=".03" mass="1"/>{0}{1}</body></worldbody>
<equality><joint joint1="left" joint2="right"/></equality>
<actuator><motor name="arm" joint="arm"/><position name="grip" joint="left" kp="50"/></actuator></mujoco>"""
PAIR = "".join((FINGERS.format("left", 0.05), FINGERS.format("right", -0.05)))


def test_a_gripper_that_nobody_logged_is_held(tmp_path: Path) -> None:
    made = drafted(tmp_path, ARM.format(PAIR, PASSIVE), "qpos.arm", "ctrl.arm")
    assert (made.idle, dict(made.missing)) == (("left", "right", "pad"), {})
    content = tomllib.loads(made.text)
    assert content["model_edit"] == {"weld": ["left", "right", "pad"]}
    assert not any(part in name for name in content["parameters"] for part in ("left", "right", "grip", "pad"))
    problem = load_problem(tmp_path / "p.toml")
    assert problem.simulator.commands == ("arm",)
    assert [signal.name for signal in problem.measurement.signals] == ["qpos.arm"]


def test_a_gripper_with_a_column_that_could_be_its_command_is_asked_about(tmp_path: Path) -> None:
    made = drafted(tmp_path, ARM.format(PAIR, ""), "qpos.arm", "ctrl.arm", "x1", "x2")
    assert made.idle == ()
    assert "ctrl.grip" in made.missing


def test_what_carries_a_measured_joint_is_not_held(tmp_path: Path) -> None:
    cart = """<mujoco><worldbody><body name="cart"><joint name="cart" type="slide"/><geom size=".1"/><body name="pole">
    <joint name="pole" axis="0 1 0"/><geom size=".05" pos="0 0 -.3"/></body></body></worldbody>
    <actuator><motor name="push" joint="cart"/></actuator></mujoco>"""
    made = drafted(tmp_path, cart, "qpos.pole")
    assert (made.idle, set(made.missing)) == ((), {"qpos.cart", "ctrl.push"})


def test_a_machine_that_nobody_commands_is_not_held(tmp_path: Path) -> None:
    """It may swing freely: the joint that was not measured is asked for."""
    made = drafted(tmp_path, ARM.format(PAIR, ""), "qpos.arm")
    assert made.idle == ()
    assert {"qpos.left", "ctrl.grip", "ctrl.arm"} <= {*made.missing}
