"""Names as public software writes them: matched rightly, and what looks like them is left alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import pytest

from onlinebayes.problems.drafting import proposed
from onlinebayes.problems.drafting.actuator_inputs import Input
from onlinebayes.problems.drafting.proposals import proposals, switches
from onlinebayes.simulators.mujoco import MujocoSimulator
from recipes.studies.convention import Convention, Drive
from recipes.studies.conventions import CONVENTIONS, UR


@pytest.mark.parametrize("convention", CONVENTIONS, ids=lambda one: one.who)
def test_none_is_matched_wrongly(convention: Convention) -> None:
    found = convention.found()
    assert {name: column for name, column in found.items() if convention.right.get(name) != column} == {}


def test_most_are_matched_in_full() -> None:
    assert len(CONVENTIONS) >= 30
    assert Counter(one.verdict for one in CONVENTIONS)["rightly"] >= len(CONVENTIONS) - 2


ARM7 = tuple(f"joint{k}" for k in range(1, 8))


def traps(joints: Sequence[str], drive: Drive, columns: Sequence[str], **right: str) -> Convention:
    """Columns of which only ``right`` (position of a joint) are the model's."""
    mine = {f"qpos.{name}": column for name, column in right.items()}
    return Convention("", joints, drive, mine, [one for one in columns if one not in mine.values()])


@pytest.mark.parametrize(
    "trap",
    [
        traps(UR, "position", [f"actual_TCP_pose_{k}" for k in range(6)]),
        traps(ARM7, "motor", [f"q{k}" for k in range(6)]),  # one joint is not logged: which?
        traps(ARM7, "motor", [f"q{k}" for k in range(8)]),
        traps(("cart", "pole"), "motor", [f"obs_{k}" for k in range(4)]),
        traps(("FL_thigh_joint", "FL_calf_joint"), "motor", ["RL_thigh_pos", "RL_calf_pos"]),
        traps(ARM7, "motor", [f"temperature_{k}" for k in range(7)]),
        traps(ARM7, "motor", [f"sensor_{k}" for k in range(7)]),
        traps(ARM7, "position", [f"{word}_{k}" for word in ("effort", "current", "pwm") for k in range(7)]),
        traps(ARM7, "motor", [f"target_q_{k}" for k in range(7)]),
        traps(("waist", "elbow"), "motor", [f"{side}_{n}" for side in ("left", "right") for n in ("waist", "elbow")]),
        traps(tuple("123456"), "position", [f"imu_{k}" for k in range(1, 7)]),
        traps(("hip", "knee"), "position", ["hip_pos_error", "hip_pos", "hip_pos_max"], hip="hip_pos"),
        traps(("hip", "knee"), "position", ["hip_pos", "knee_pos", "hip_filtered_pos", "knee_filtered_pos"],
              hip="hip_pos", knee="knee_pos"),
        traps(("hip", "knee"), "motor", ["hip_pos", "knee_pos", "hip_wish_pos", "knee_wish_pos"],
              hip="hip_pos", knee="knee_pos"),  # no servo is told a position
        traps(("free:a",), "motor", ["target_x", "target_y", "target_z", "vx", "vy", "vz"]),
        traps(("free:a",), "motor", ["left_x", "left_y", "left_z", "right_x", "right_y", "right_z"]),
    ],
)  # fmt: skip
def test_what_only_looks_like_a_name_is_left_alone(trap: Convention) -> None:
    assert trap.found() == trap.right


def test_numbers_from_zero_are_not_joints_numbered_from_one() -> None:
    """``joint1_pos`` is the second joint where ``joint0_pos`` is there, though a joint is called joint1."""
    names = [f"qpos.{joint}" for joint in ARM7]
    found = {one.name: one for one in proposals(names, [f"joint{k}_pos" for k in range(7)], {})}
    assert found["qpos.joint1"].column == "joint0_pos"
    assert found["qpos.joint7"].why == "a guess, by order"
    some = {one.name: one.column for one in proposals(names, ["joint3_pos", "joint4_pos"], {})}
    assert some == {"qpos.joint3": "joint3_pos", "qpos.joint4": "joint4_pos"}


def test_a_joint_is_known_by_a_word_that_no_other_has() -> None:
    names = ["qpos.shoulder_lift", "qpos.shoulder_pan", "qpos.elbow_flex"]
    (found,) = proposals(names, ["elbow_pos", "shoulder_pos"], {})
    assert (found.name, found.column) == ("qpos.elbow_flex", "elbow_pos")
    assert found.why == "a guess, no other name of the model has 'elbow'"


def test_a_joint_and_its_sensor_of_one_machine() -> None:
    found = {one.name: one for one in proposals(["qpos.hinge", "ctrl.motor"], ["action", "sensor"], {})}
    assert found["ctrl.motor"].column == "action"
    assert found["qpos.hinge"].column == "sensor"
    assert found["qpos.hinge"].why.startswith("a guess")


def test_a_thrust_is_that_of_the_only_actuator_called_so() -> None:
    names = ["ctrl.body_thrust", "ctrl.x_moment", "ctrl.y_moment"]
    assert [(one.name, one.column) for one in proposals(names, ["thrust"], {})] == [("ctrl.body_thrust", "thrust")]


def test_an_actuator_answers_to_its_joint() -> None:
    inputs = {"ctrl.m0": Input("qpos", "hip"), "ctrl.m1": Input("qpos", "knee")}
    found = proposals(["ctrl.m0", "ctrl.m1"], ["knee_target", "hip_target"], inputs)
    assert {one.name: one.column for one in found} == {"ctrl.m0": "hip_target", "ctrl.m1": "knee_target"}


def test_the_longer_of_twins_is_called_a_guess() -> None:
    inputs = {"ctrl.hip": Input("qpos", "hip")}
    found = {one.name: one for one in proposals(["qpos.hip", "ctrl.hip"], ["hip_pos", "hip_wish_pos"], inputs)}
    assert found["ctrl.hip"].why == "a guess, it differs from what was measured by the word 'wish' alone"


def test_a_quaternion_is_turned_to_w_first() -> None:
    model = "<mujoco><worldbody><body><freejoint name='base'/><geom size='1'/></body></worldbody></mujoco>"
    columns = ["x", "y", "z", "qx", "qy", "qz", "qw"]
    found = proposed(MujocoSimulator(model, threads=1), columns)
    assert [found[f"qpos.base.{k}"] for k in range(7)] == ["x", "y", "z", "qw", "qx", "qy", "qz"]


def test_one_pose_beside_two_free_joints_is_nobodys_unless_it_is_named() -> None:
    names = [f"qpos.{joint}.{k}" for joint in ("cup", "lid") for k in range(7)]
    assert proposals(names, ["x", "y", "z", "qw", "qx", "qy", "qz"], {}) == ()
    found = {one.name for one in proposals(names, ["lid_x", "lid_y", "lid_z"], {})}
    assert found == {f"qpos.lid.{k}" for k in range(3)}


def test_a_switch_is_the_only_actuators_or_named() -> None:
    assert [one.column for one in switches(["motor"], ["enable", "angle"])] == ["enable"]
    assert switches(["left", "right"], ["enable"]) == ()
    assert [(one.name, one.column) for one in switches(["left", "right"], ["left_enable"])] == [
        ("enable.left", "left_enable")
    ]
