"""What a log shows that the model is not is said in one line: a base on a stand, a machine without a motor."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from onlinebayes.problems import load_problem
from onlinebayes.problems.drafting.first_draft import Draft, draft
from onlinebayes.runs import BadInput

LEG = """<body pos=".1 0 0"><joint name="hip" axis="0 1 0" damping="1"/><geom size=".05" mass=".3"/></body>"""
DOG = f"""<mujoco><worldbody><body name="base" pos="0 0 1"><freejoint/><geom size=".1" mass="2"/>{LEG}</body>
</worldbody><actuator><motor name="hip" joint="hip"/></actuator></mujoco>"""
CART = """<mujoco><worldbody><body name="cart"><joint name="cart" type="slide" axis="1 0 0" damping="1"/>
<geom size=".1" mass="1"/></body></worldbody>{}</mujoco>"""
URDF = """<robot name="r"><link name="base"/><link name="l"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link><joint name="cart" type="prismatic">
<parent link="base"/><child link="l"/><axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""
SERVO = """<mujoco><option timestep="0.005" integrator="implicitfast"/><worldbody><body name="horn" pos="0 0 1">
<joint name="servo" axis="0 1 0" damping="0.05"/><geom type="capsule" fromto="0 0 0 .1 0 0" size=".02" mass=".3"/>
</body></worldbody><actuator><position name="servo" joint="servo" kp="20" kv="0.3"/></actuator></mujoco>"""


def drafted(folder: Path, model: str, *names: str) -> Draft:
    time = np.arange(300) * 0.02
    columns = [time, *(0.3 * np.sin(2 * time + 0.5 * time**2 + k) for k in range(len(names)))]
    rows = "\n".join(",".join(f"{cell:.6f}" for cell in row) for row in np.stack(columns, 1))
    (folder / "log.csv").write_text(f"time,{','.join(names)}\n{rows}\n")
    (folder / "model.xml").write_text(model)
    made = draft(folder / "model.xml", [folder / "log.csv"], folder / "p.toml")
    (folder / "p.toml").write_text(made.text)
    return made


def test_a_base_that_nobody_measured_is_one_line_with_the_weld(tmp_path: Path) -> None:
    made = drafted(tmp_path, DOG, "hip_pos", "hip_cmd")
    assert made.missing == {}
    assert made.fixed == {"qpos.joint0": "base"}
    assert made.text.count("MISSING") == 1
    (tmp_path / "p.toml").write_text(made.text.replace("# [model_edit]", "[model_edit]").replace("# weld", "weld"))
    signals = load_problem(tmp_path / "p.toml").measurement.signals
    assert [signal.name for signal in signals] == ["qpos.hip"]


def test_a_base_of_which_something_was_measured_stays_a_question(tmp_path: Path) -> None:
    made = drafted(tmp_path, DOG, "hip_pos", "hip_cmd", "base_x", "base_y", "base_z")
    assert made.fixed == {}
    assert [*made.missing] == [f"qpos.joint0.{k}" for k in range(3, 7)]


@pytest.mark.parametrize(("model", "hint"), [(CART.format(""), ""), (URDF, "a URDF has none")])
def test_commands_of_a_model_without_a_motor_are_not_ignored(tmp_path: Path, model: str, hint: str) -> None:
    made = drafted(tmp_path, model, "qpos.cart", "ctrl.pusher")
    (asked,) = made.questions
    assert "the log has the command ctrl.pusher" in asked
    assert '<actuator><motor name="pusher" joint="cart"/></actuator>' in asked
    assert hint in asked
    assert "ignore" not in tomllib.loads(made.text)
    with pytest.raises(BadInput, match="the model has no actuator"):
        load_problem(tmp_path / "p.toml")


@pytest.mark.parametrize(
    ("command", "actuator"),
    [("cmd_vel", "velocity kv"), ("target_position", "position kp"), ("goal", "position kp"), ("torque_cmd", "motor")],
)
def test_the_actuator_to_add_takes_what_the_log_commands(tmp_path: Path, command: str, actuator: str) -> None:
    (asked,) = drafted(tmp_path, CART.format(""), "qpos.cart", command).questions
    assert f"<actuator><{actuator}" in asked


def test_the_actuator_to_add_acts_on_the_joint_that_the_command_names(tmp_path: Path) -> None:
    links = "".join(f'<body pos="0 0 .1"><joint name="joint_{k}"/><geom size=".1"/>' for k in (1, 2))
    model = f"<mujoco><worldbody>{links}</body></body></worldbody></mujoco>"
    names = [f"joint_{k}.{what}" for what in ("position", "cmd_vel") for k in (1, 2)]
    (asked,) = drafted(tmp_path, model, *names).questions
    assert '<velocity kv="..." name="joint_1" joint="joint_1"/></actuator>, one for each, to the model' in asked


def test_a_machine_without_commands_needs_no_motor(tmp_path: Path) -> None:
    assert drafted(tmp_path, CART.format(""), "qpos.cart", "temperature").questions == ()


def test_a_servo_has_its_kp_freed_and_no_gear(tmp_path: Path) -> None:
    freed = tomllib.loads(drafted(tmp_path, SERVO, "qpos.servo", "ctrl.servo").text)["parameters"]
    assert freed["actuator.servo.kp"] == [2.0, 60.0]
    assert not any("gear" in name for name in freed)


def test_a_velocity_servo_has_its_kv_freed_and_no_gear(tmp_path: Path) -> None:
    model = SERVO.replace(
        '<position name="servo" joint="servo" kp="20" kv="0.3"/>', '<velocity name="servo" joint="servo" kv="2"/>'
    )
    freed = tomllib.loads(drafted(tmp_path, model, "qpos.servo", "cmd_vel_servo").text)["parameters"]
    assert freed["actuator.servo.kv"] == [0.2, 6.0]
    assert not any("gear" in name or "kp" in name for name in freed)


def test_what_a_machine_may_have_none_of_is_bounded_from_zero(tmp_path: Path) -> None:
    passive = 'damping="0.5" stiffness="200" frictionloss="0.03"'
    cart = CART.format('<actuator><motor name="m" joint="cart" gear="200"/></actuator>').replace('damping="1"', passive)
    freed = tomllib.loads(drafted(tmp_path, cart, "qpos.cart", "ctrl.m").text)["parameters"]
    own = {"damping": 0.5, "stiffness": 200.0, "frictionloss": 0.03}
    assert {field: freed[f"joint.cart.{field}"] for field in own} == {
        field: [0.0, pytest.approx(3 * value)] for field, value in own.items()
    }


def test_what_was_matched_stands_in_the_models_order(tmp_path: Path) -> None:
    """Numbers of the machine's own name are in every column: they are those of some joints."""
    links = "".join(f'<body pos="0 0 .1"><joint name="joint_{k}"/><geom size=".1"/>' for k in (1, 2, 3))
    model = f"<mujoco><worldbody>{links}</body></body></body></worldbody></mujoco>"
    made = drafted(tmp_path, model, *(f"j2n3_joint_{k}.position" for k in (3, 1, 2)))
    assert [(one.name, one.column) for one in made.matches] == [
        (f"qpos.joint_{k}", f"j2n3_joint_{k}.position") for k in (1, 2, 3)
    ]
