"""Names that public software gives to the columns of its logs, each with a model and the right answer.

What a header has besides must stay unused: temperatures, poses of the tool, gains.
"""

from __future__ import annotations

from collections.abc import Sequence

from recipes.studies.convention import Convention

SO101 = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
UR = tuple(f"{part}_joint" for part in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"))
LEGS = tuple(f"{leg}_{part}_joint" for leg in ("FL", "FR", "RL", "RR") for part in ("hip", "thigh", "calf"))
ARM7 = tuple(f"joint{k}" for k in range(1, 8))
ALOHA = tuple(
    f"{side}_{part}"
    for side in ("left", "right")
    for part in ("waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate")
)


def _rows(names: Sequence[str], columns: str, kind: str = "qpos", first: int = 0) -> dict[str, str]:
    """``{n}`` and ``{k}`` in ``columns`` for a name and its number."""
    return {f"{kind}.{name}": columns.format(n=name, k=first + k) for k, name in enumerate(names)}


def _both(
    names: Sequence[str], measured: str, told: str, speed: str = "", actuators: Sequence[str] = (), first: int = 0
) -> dict[str, str]:
    speeds = _rows(names, speed, "qvel", first) if speed else {}
    orders = {
        f"ctrl.{own}": told.format(n=name, k=first + k)
        for k, (own, name) in enumerate(zip(actuators or names, names, strict=True))
    }
    return _rows(names, measured, first=first) | speeds | orders


def _short(names: Sequence[str]) -> list[str]:
    return [name.removesuffix("_joint") for name in names]


def _pose(joint: str, *columns: str) -> dict[str, str]:
    return {f"qpos.{joint}.{k}": column for k, column in enumerate(columns)}


RTDE = (
    "timestamp",
    "actual_TCP_pose_0",
    "actual_TCP_pose_1",
    "actual_TCP_pose_2",
    "actual_TCP_pose_3",
    "actual_TCP_pose_4",
    "actual_TCP_pose_5",
    "speed_scaling",
    *(f"actual_current_{k}" for k in range(6)),
    *(f"joint_temperatures_{k}" for k in range(6)),
    *(f"target_qd_{k}" for k in range(6)),
    *(f"target_moment_{k}" for k in range(6)),
    *(f"actual_joint_voltage_{k}" for k in range(6)),
)
UNITREE = (
    "tick",
    *(f"motor_state[{k}].{part}" for k in range(12) for part in ("ddq", "tau_est", "temperature")),
    *(f"motor_cmd[{k}].{part}" for k in range(12) for part in ("dq", "kp", "kd", "tau")),
)
FRANKA = (
    *(f"tau_J[{k}]" for k in range(7)),
    *(f"theta[{k}]" for k in range(7)),
    *(f"tau_ext_hat_filtered[{k}]" for k in range(7)),
    *(f"O_T_EE[{k}]" for k in range(16)),
    *(f"ddq_d[{k}]" for k in range(7)),
)
LEG2 = ("FL_thigh_joint", "FL_calf_joint")
AXES = "xyz"

CONVENTIONS: tuple[Convention, ...] = (
    Convention("onlinebayes", ARM7, "motor", _both(ARM7, "qpos.{n}", "ctrl.{n}", "qvel.{n}")),
    Convention(
        "LeRobot 0.3, features with names",
        SO101,
        "position",
        _both(SO101, "observation.state[{n}.pos]", "action[{n}.pos]"),
        ("frame_index", "index", "task_index"),
    ),
    Convention(
        "LeRobot, flattened with dots",
        SO101,
        "position",
        _both(SO101, "observation.state.{n}.pos", "action.{n}.pos"),
        ("episode_index", "next.reward", "next.done"),
    ),
    Convention(
        "LeRobot 0.1, one arm", SO101, "position", _both(SO101, "observation.state[main_{n}]", "action[main_{n}]")
    ),
    Convention(
        "LeRobot without names",
        SO101,
        "position",
        _both(SO101, "observation.state[{k}]", "action[{k}]"),
        ("timestamp", "frame_index"),
    ),
    Convention(
        "LeRobot ALOHA",
        ALOHA,
        "position",
        _both(ALOHA, "observation.state[{n}]", "action[{n}]"),
        tuple(f"observation.effort[{n}]" for n in ALOHA),
    ),
    Convention(
        "UR RTDE, position servos",
        UR,
        "position",
        _both(UR, "actual_q_{k}", "target_q_{k}", "actual_qd_{k}", _short(UR)),
        RTDE,
        _short(UR),
    ),
    Convention(
        "UR RTDE of ur_rtde (brackets)", UR, "position", _both(UR, "actual_q[{k}]", "target_q[{k}]", "actual_qd[{k}]")
    ),
    Convention("libfranka, torques", ARM7, "motor", _both(ARM7, "q[{k}]", "tau_J_d[{k}]", "dq[{k}]"), FRANKA),
    Convention(
        "libfranka, positions",
        ARM7,
        "position",
        _both(ARM7, "q[{k}]", "q_d[{k}]", "dq[{k}]"),
        (*FRANKA, *(f"dq_d[{k}]" for k in range(7))),
    ),
    Convention("Franka, numbered without brackets", ARM7, "position", _both(ARM7, "q{k}", "q_d{k}")),
    Convention(
        "Unitree low state and command",
        LEGS,
        "position",
        _both(LEGS, "motor_state[{k}].q", "motor_cmd[{k}].q", "motor_state[{k}].dq", _short(LEGS)),
        UNITREE,
        _short(LEGS),
    ),
    Convention(
        "Unitree SDK 1 (motorState)",
        LEGS,
        "motor",
        _both(LEGS, "motorState[{k}].q", "motorCmd[{k}].tau", "motorState[{k}].dq", _short(LEGS)),
        tuple(f"motorState[{k}].tauEst" for k in range(12)),
        _short(LEGS),
    ),
    Convention(
        "rostopic echo -p, JointState",
        ARM7,
        "position",
        _rows(ARM7, "field.position{k}") | _rows(ARM7, "field.velocity{k}", "qvel"),
        (
            "%time",
            "field.header.seq",
            "field.header.stamp",
            "field.header.frame_id",
            *(f"field.name{k}" for k in range(7)),
            *(f"field.effort{k}" for k in range(7)),
        ),
    ),
    Convention(
        "JointState with names and efforts",
        UR,
        "position",
        _rows(UR, "/joint_states.position[{n}]") | _rows(UR, "/joint_states.velocity[{n}]", "qvel"),
        tuple(f"/joint_states.effort[{n}]" for n in UR),
        _short(UR),
    ),
    Convention(
        "JointState with efforts, motors", LEG2, "motor", _both(LEG2, "position[{n}]", "effort[{n}]", "velocity[{n}]")
    ),
    Convention(
        "PlotJuggler",
        UR,
        "position",
        _both(
            UR,
            "/joint_states/{n}/position",
            "/joint_group_position_controller/commands/{n}",
            "/joint_states/{n}/velocity",
        ),
    ),
    Convention(
        "ros2_control state and reference",
        UR,
        "position",
        _both(UR, "{n}/position", "{n}/position_command", "{n}/velocity"),
    ),
    Convention(
        "joint_trajectory_controller",
        UR,
        "position",
        _both(UR, "actual.positions[{k}]", "desired.positions[{k}]", "actual.velocities[{k}]"),
        (
            *(f"error.positions[{k}]" for k in range(6)),
            *(f"desired.velocities[{k}]" for k in range(6)),
            *(f"desired.accelerations[{k}]" for k in range(6)),
        ),
    ),
    Convention(
        "joint_trajectory_controller of ROS 2",
        UR,
        "position",
        _both(UR, "feedback.positions[{n}]", "reference.positions[{n}]"),
        tuple(f"error.positions[{n}]" for n in UR),
    ),
    Convention(
        "quadrotor, q and u",
        ("free:quad",),
        "motor",
        _pose("quad", *(f"q{k}" for k in range(7))) | {f"ctrl.rotor{k + 1}": f"u{k}" for k in range(4)},
        actuators=tuple(f"rotor{k + 1}" for k in range(4)),
    ),
    Convention(
        "quadrotor, motion capture and thrusts",
        ("free:quad",),
        "motor",
        _pose("quad", "x", "y", "z", "qw", "qx", "qy", "qz") | {f"ctrl.thrust{k + 1}": f"thrust_{k}" for k in range(4)},
        actuators=tuple(f"thrust{k + 1}" for k in range(4)),
    ),
    Convention(
        "geometry_msgs/Pose",
        ("free:base",),
        "motor",
        _pose("base", *(f"pose.position.{a}" for a in AXES), *(f"pose.orientation.{a}" for a in "wxyz")),
        tuple(f"twist.{part}.{a}" for part in ("linear", "angular") for a in AXES),
    ),
    Convention(
        "pos_x and quat_w",
        ("free:base",),
        "motor",
        _pose("base", "pos_x", "pos_y", "pos_z", "quat_w", "quat_x", "quat_y", "quat_z"),
        ("vel_x", "vel_y", "vel_z"),
    ),
    Convention(
        "px and qw",
        ("free:body",),
        "motor",
        _pose("body", "px", "py", "pz", "qw", "qx", "qy", "qz"),
        ("vx", "vy", "vz", "wx", "wy", "wz"),
    ),
    Convention(
        "legged: base beside joints without 'joint'",
        ("free:floating_base", *LEG2),
        "position",
        _pose(
            "floating_base",
            "base_pos_x",
            "base_pos_y",
            "base_pos_z",
            "base_quat_w",
            "base_quat_x",
            "base_quat_y",
            "base_quat_z",
        )
        | _both(LEG2, "q_{n}", "cmd_{n}"),
        ("imu_acc_x", "imu_acc_y", "imu_acc_z"),
    ),
    Convention(
        "Gymnasium, obs and action", ARM7, "motor", _both(ARM7, "obs_{k}", "action_{k}"), ("reward", "terminated")
    ),
    Convention(
        "legged_gym (dof_pos, actions)",
        LEGS,
        "position",
        _both(LEGS, "dof_pos[{k}]", "dof_pos_target[{k}]", "dof_vel[{k}]", _short(LEGS)),
        tuple(f"dof_torque[{k}]" for k in range(12)),
        _short(LEGS),
    ),
    Convention(
        "Isaac Lab (joint_pos, joint_pos_target)",
        LEGS,
        "position",
        _both(LEGS, "joint_pos[{k}]", "joint_pos_target[{k}]", "joint_vel[{k}]"),
        tuple(f"applied_torque[{k}]" for k in range(12)),
    ),
    Convention("legged, des before pos", LEG2, "position", _both(LEG2, "{n}_pos", "{n}_des_pos", "{n}_vel")),
    Convention("legged, short names with sp", ("hip", "knee"), "position", _both(("hip", "knee"), "{n}_pos", "{n}_sp")),
    Convention("legged, tgt", ("hip", "knee"), "position", _both(("hip", "knee"), "{n}_q", "{n}_q_tgt")),
    Convention(
        "a word that nobody knows", ("hip", "knee"), "position", _both(("hip", "knee"), "{n}_pos", "{n}_wish_pos")
    ),
    Convention(
        "Dynamixel",
        ("pan", "tilt"),
        "position",
        _both(("pan", "tilt"), "Present_Position_{n}", "Goal_Position_{n}", "Present_Velocity_{n}"),
        ("Present_Temperature_pan", "Present_Current_pan"),
    ),
    Convention(
        "CamelCase (Simulink)",
        ("LeftHip", "LeftKnee"),
        "motor",
        _both(("LeftHip", "LeftKnee"), "{n}Angle", "{n}TorqueCmd", "{n}Velocity"),
    ),
    Convention(
        "one joint: angle and action",
        ("hinge",),
        "motor",
        {"qpos.hinge": "angle", "ctrl.motor": "action"},
        actuators=("motor",),
    ),
    Convention("numbered from 1", ARM7, "motor", _both(ARM7, "q{k}", "tau{k}", "qd{k}", first=1)),
    Convention(
        "xArm SDK",
        ARM7,
        "position",
        _both(ARM7, "joint_{k}_actual", "joint_{k}_target", first=1),
        ("tcp_x", "tcp_y", "tcp_z"),
    ),
    Convention("MoveIt, current and goal", UR, "position", _both(UR, "current_position_{n}", "goal_position_{n}")),
    Convention(
        "teleoperation, leader and follower", SO101, "position", _both(SO101, "follower_{n}_pos", "leader_{n}_pos")
    ),
    Convention(
        "Drake, state and input",
        ("shoulder", "elbow"),
        "motor",
        _both(("shoulder", "elbow"), "{n}_q", "u{k}", "{n}_v"),
        ("iteration",),
    ),
    Convention("Pinocchio, q v tau", ARM7, "motor", _both(ARM7, "q[{k}]", "tau[{k}]", "v[{k}]")),
    Convention(
        "Kinova",
        ARM7,
        "position",
        _both(ARM7, "actuators[{k}].position", "actuators_command[{k}].position", "actuators[{k}].velocity"),
        tuple(f"actuators[{k}].torque" for k in range(7)),
    ),
    Convention(
        "ODrive",
        ("axis0",),
        "velocity",
        {
            "qpos.axis0": "axis0.encoder.pos_estimate",
            "qvel.axis0": "axis0.encoder.vel_estimate",
            "ctrl.axis0": "axis0.controller.vel_setpoint",
        },
        ("axis0.motor.current_control.Iq_measured",),
    ),
    Convention(
        "dm_control",
        ("shoulder", "elbow"),
        "motor",
        _both(("shoulder", "elbow"), "observation/joint_angles[{k}]", "action[{k}]"),
        ("reward", "discount"),
    ),
)
