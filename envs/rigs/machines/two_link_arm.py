"""Two links in a vertical plane, a motor at each joint; equations in :class:`TwoLink`."""

from __future__ import annotations

import math

from envs.rigs.drive import Actuator
from envs.rigs.equations import Equations, Lever, TwoLink, Values
from envs.rigs.off_numbers import OffNumber
from envs.rigs.rig import HiddenEffect, Protocol, Rig, Tie

_ENCODER = 2 * math.pi / 8192  # [rad]


def _two_link(values: Values) -> Equations:
    return TwoLink(Lever.of(values, "upper", 0.16, 0.012), Lever.of(values, "fore", 0.13, 0.005), 0.35)


TWO_LINK_ARM = Rig(
    name="two_link_arm",
    joints=("shoulder", "elbow"),
    actuators=(Actuator("shoulder_motor", 0, reference=3.0), Actuator("elbow_motor", 1, reference=1.0)),
    nominal={
        "body.upper.mass": 1.2,
        "body.fore.mass": 0.7,
        "joint.shoulder.damping": 0.25,
        "joint.elbow.damping": 0.1,
        "joint.shoulder.armature": 0.02,
        "joint.elbow.armature": 0.01,
    },
    free={
        "body.upper.mass": (0.4, 3.0),
        "body.fore.mass": (0.2, 2.0),
        "joint.shoulder.damping": (0.0, 2.0),
        "joint.elbow.damping": (0.0, 1.0),
    },
    equations=_two_link,
    protocol=Protocol(
        step=1e-3,
        period=5,
        jitter=0,
        fit=8,
        held=2,
        seconds=4.2,
        resolution=(_ENCODER, _ENCODER),
        sd=(1e-3, 1e-3),
        speed_sd=(),
        amplitude=(2.5, 0.8),
        band=(0.2, 2.0),
    ),
    effects=(
        HiddenEffect("dry_friction@shoulder", {"frictionloss": 0.026}),
        HiddenEffect("dry_friction@elbow", {"frictionloss": 0.0072}),
        HiddenEffect("stribeck_friction@elbow", {"coulomb": 0.0072, "static": 0.014}, {"stribeck_velocity": 0.2}),
        HiddenEffect("load_dependent_friction@shoulder", {"mu": 0.016}),
        HiddenEffect("quadratic_drag@elbow", {"drag": 0.0012}),
        HiddenEffect("joint_stiffness@shoulder", {"stiffness": 0.038}, {"springref": 0.3}),
        HiddenEffect("cubic_stiffness@elbow", {"stiffness3": 0.0076}, {"springref": 0.0}),
        HiddenEffect("constant_load@elbow", {"load": 0.0029}),
        HiddenEffect("armature@elbow", {"armature": 0.00025}),
        HiddenEffect("com_offset@fore", {"x": 0.00064}),
        HiddenEffect("actuator_gain@shoulder_motor", {"gain": 0.016}),
        HiddenEffect("actuator_delay@shoulder_motor", {"delay": 0.0022}),
        HiddenEffect("actuator_lag@elbow_motor", {"time_constant": 0.0019}),
        HiddenEffect("actuator_saturation@elbow_motor", {"limit": 1.4}, shrinks=True),
        HiddenEffect("thermal_derating@shoulder_motor", {"coefficient": 0.12}, {"time_constant": 2.0}),
        HiddenEffect("sensor_bias@qpos.elbow", {"bias": 0.0079}),
        HiddenEffect("sensor_delay@qpos.elbow", {"delay": 0.0032}),
    ),
    last=(HiddenEffect("cogging@elbow", {"amplitude": 0.011}, {"poles": 8.0, "phase": 0.5}),),
    by_name=(HiddenEffect("backlash@elbow", {"gap": 0.08}, {"rotor": 0.002}),),
    outside=(
        HiddenEffect("detent@elbow", {"amplitude": 0.021}, {"poles": 5.0, "speed": 1.0}),
        HiddenEffect("periodic@shoulder", {"amplitude": 0.028}, {"frequency": 1.1, "phase": 0.6}),
        HiddenEffect("flexible_mode@shoulder", {"mass": 0.0015}, {"frequency": 1.4}),
    ),
    ties=(
        Tie(
            HiddenEffect("back_emf@shoulder_motor", {"constant": 0.04}),
            "viscous_friction@shoulder",
            ("joint.shoulder.damping",),
        ),
        Tie(
            HiddenEffect("back_emf@elbow_motor", {"constant": 0.012}),
            "viscous_friction@elbow",
            ("joint.elbow.damping",),
        ),
    ),
    alike=(
        ("com_offset@fore", "sensor_bias@qpos.elbow"),
        # With the link's mass free: inertia over weight.
        ("armature@shoulder", "com_offset@upper.z"),
        ("actuator_delay@shoulder_motor", "actuator_lag@shoulder_motor"),
        ("actuator_delay@elbow_motor", "actuator_lag@elbow_motor"),
    ),
    surplus=(
        OffNumber("joint.shoulder.frictionloss", "dry_friction@shoulder", 0.027),
        OffNumber("joint.elbow.frictionloss", "dry_friction@elbow", 0.0057),
        OffNumber("joint.shoulder.stiffness", "joint_stiffness@shoulder", 0.08),
        OffNumber("joint.elbow.stiffness", "joint_stiffness@elbow", 0.004),
    ),
    own=(
        OffNumber("joint.elbow.armature", "armature@elbow", 0.00027),
        OffNumber("joint.shoulder.armature", "armature@shoulder", 0.0014),
        OffNumber("body.fore.ipos[0]", "com_offset@fore.x", 0.001),
        OffNumber("body.fore.ipos[2]", "com_offset@fore.z", 0.0016),
        OffNumber("actuator.shoulder_motor.gear[0]", "actuator_gain@shoulder_motor", 0.018),
    ),
    moments={"body.upper.inertia[1]": "armature@shoulder"},
)
