"""Columns are matched with names of the model by their words and units."""

from __future__ import annotations

import mujoco
import pytest

from onlinebayes.problems.drafting.actuator_inputs import actuator_inputs
from onlinebayes.problems.drafting.matching import Match, match


@pytest.mark.parametrize(
    ("names", "columns", "found"),
    [
        (["qpos.hip", "qpos.knee"], ["HipPos", "KneePos"], {"qpos.hip": "HipPos", "qpos.knee": "KneePos"}),
        (
            ["qpos.hip", "qvel.hip"],
            ["hip_angle_deg", "hip_speed"],
            {"qpos.hip": "hip_angle_deg", "qvel.hip": "hip_speed"},
        ),
        (["qpos.left_knee"], ["right_knee_pos", "left_knee_pos"], {"qpos.left_knee": "left_knee_pos"}),
        (["qpos.hinge", "ctrl.motor"], ["angle", "torque_cmd"], {"qpos.hinge": "angle", "ctrl.motor": "torque_cmd"}),
        (["qpos.a", "qpos.b"], ["position"], {}),  # whose?
        (["qpos.hinge"], ["angle", "position"], {}),  # which?
        (["ctrl.motor"], ["drive_V"], {"ctrl.motor": "drive_V"}),
        (["qpos.hinge"], ["temperature"], {}),
        (["ctrl.motor"], ["motor_speed"], {}),  # not what it was told
        (["qpos.rod", "ctrl.coil"], ["rod", "coil"], {"qpos.rod": "rod", "ctrl.coil": "coil"}),
        (["qpos.coil", "ctrl.coil"], ["coil"], {"qpos.coil": "coil"}),  # the joint's claim
        (["ctrl.coil"], ["coil_A"], {"ctrl.coil": "coil_A"}),
        (["ctrl.coil"], ["coil_current"], {"ctrl.coil": "coil_current"}),
        (["ctrl.coil"], ["coil_current_A"], {"ctrl.coil": "coil_current_A"}),
        (["ctrl.coil"], ["amps"], {"ctrl.coil": "amps"}),
        (["ctrl.coil"], ["channel_A"], {}),  # a letter is no unit without the name
        (["ctrl.coil"], ["coil_A", "coil_current"], {}),  # which?
        (["ctrl.coil"], ["coil_cmd", "coil_current"], {"ctrl.coil": "coil_cmd"}),  # the other was measured
        (["ctrl.coil"], ["coil", "u_cmd"], {"ctrl.coil": "u_cmd"}),
        (["ctrl.a", "ctrl.b"], ["a_pwm", "b_duty"], {"ctrl.a": "a_pwm", "ctrl.b": "b_duty"}),
        (["ctrl.a", "ctrl.b"], ["amps"], {}),  # whose?
        (["qpos.hip"], ["hip_current"], {}),
        (["ctrl.hip"], ["hip_torque_target", "hip_torque"], {"ctrl.hip": "hip_torque_target"}),
        (["ctrl.hip"], ["hip_target_position"], {}),  # nothing says that the actuator is told one
        (["qpos.hip"], ["hip_goal"], {}),
        (
            ["qpos.tilt", "ctrl.tilt_motor"],
            ["tilt_deg", "tilt_motor_Nm"],
            {"qpos.tilt": "tilt_deg", "ctrl.tilt_motor": "tilt_motor_Nm"},
        ),
    ],
)
def test_names(names, columns, found) -> None:
    assert {one.name: one.column for one in match(names, columns)} == found


@pytest.mark.parametrize(
    ("actuator", "column", "unit"),
    [
        ("velocity kv", "belt_speed_cmd_mm/s", "mm/s"),
        ("velocity kv", "belt_target_vel", ""),
        ("intvelocity kp", "belt_speed_setpoint", ""),
        ("position kp", "belt_pos_cmd", ""),
        ("position kp", "belt_goal_mm", "mm"),
        ("position kp", "belt_desired_position", ""),
        ("position kp", "belt_pos", None),  # measured
        ("position kp", "belt_speed_cmd", None),
        ("motor gear", "belt_pos_cmd", None),
    ],
)
def test_a_servo_is_told_a_position_or_a_speed(actuator: str, column: str, unit: str | None) -> None:
    name, gain = actuator.split()
    servo = f'<actuator><{name} name="belt" joint="track" {gain}="7" /></actuator>'
    if name == "intvelocity":
        servo = servo.replace(" />", ' actrange="-1 1"/>')
    body = '<body><joint name="track" type="slide"/><geom size="1"/></body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body}</worldbody>{servo}</mujoco>")
    matched = match(["qpos.track", "ctrl.belt"], [column], actuator_inputs(model))
    found = [one for one in matched if one.name == "ctrl.belt"]
    assert found == ([] if unit is None else [Match("ctrl.belt", column, unit)])


def test_units_in_names() -> None:
    names = ["qpos.hip", "qvel.hip"]
    assert match(names, ["hip_pos_deg", "hip_vel_deg"]) == (
        Match("qpos.hip", "hip_pos_deg", "deg"),
        Match("qvel.hip", "hip_vel_deg", "deg/s"),
    )


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        ("drive_torque_mNm", "mNm"),
        ("drive torque [mN m]", "mN m"),
        ("drive_cmd_kN", "kN"),
        ("drive_mA", "mA"),
        ("/drive.cmd(mV)", "mV"),
        ("drive_torque_Nm", ""),  # SI
        ("drive_cmd_ms", ""),  # no unit of a push
        ("drive_cmd_raw", ""),
    ],
)
def test_a_commands_unit_is_the_end_of_its_columns_name(column: str, unit: str) -> None:
    assert match(["ctrl.drive"], [column]) == (Match("ctrl.drive", column, unit),)


@pytest.mark.parametrize(
    ("column", "name", "unit"),
    [
        ("carriage_mm_s", "qvel.carriage", "mm/s"),
        ("carriage [mm/s]", "qvel.carriage", "mm/s"),
        ("carriage_rpm", "qvel.carriage", "rpm"),
        ("carriage_m_s", "qvel.carriage", ""),
        ("carriage_deg/s", "qvel.carriage", "deg/s"),
        ("carriage_mm", "qpos.carriage", "mm"),
        ("carriage angle (°)", "qpos.carriage", "deg"),
        ("carriage_m", "qpos.carriage", ""),
    ],
)
def test_a_unit_of_a_speed_is_no_position(column: str, name: str, unit: str) -> None:
    (found,) = match(["qpos.carriage", "qvel.carriage"], [column])
    assert (found.name, found.unit) == (name, unit)


@pytest.mark.parametrize("column", ["carriage_counts", "carriage_pos_raw", "carriage_angle_grad", "carriage_um_s"])
def test_a_unit_that_nobody_knows_is_not_taken_for_si(column: str) -> None:
    assert match(["qpos.carriage", "qvel.carriage"], [column]) == ()
