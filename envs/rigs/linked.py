"""The rigs whose parts move one another: a cart with a pole, an arm of two links, an arm of six joints."""

from __future__ import annotations

import math

from envs.rigs.chain import SixJoint
from envs.rigs.drive import Actuator
from envs.rigs.equations import CartPole, Equations, Lever, TwoLink, Values, mass
from envs.rigs.rig import HiddenEffect, Protocol, Rig, Tie

_ENCODER = 2 * math.pi / 8192  # [rad]


def _cart_pole(values: Values) -> Equations:
    return CartPole(mass(values, "cart"), Lever.of(values, "pole", 0.25, 0.004))


CART_POLE = Rig(
    name="cart_pole",
    joints=("slider", "hinge"),
    actuators=(Actuator("motor", 0, reference=1.0),),
    nominal={
        "body.cart.mass": 0.7,
        "body.pole.mass": 0.2,
        "joint.slider.damping": 0.8,
        "joint.hinge.damping": 0.002,
        "actuator.motor.gear[0]": 5.0,
    },
    free={
        "body.cart.mass": (0.2, 2.0),
        "body.pole.mass": (0.05, 0.6),
        "joint.slider.damping": (0.0, 5.0),
        "joint.hinge.damping": (0.0, 0.02),
    },
    equations=_cart_pole,
    protocol=Protocol(
        step=1e-3,
        period=5,
        jitter=0,
        fit=8,
        held=2,
        seconds=6.0,
        resolution=(1e-5, _ENCODER),
        sd=(1e-4, 5e-4),
        speed_sd=(2e-3, 1e-2),
        amplitude=(0.12,),
        feedback=((6.0, 0.8),),
        band=(0.2, 1.2),
    ),
    effects=(
        HiddenEffect("dry_friction@slider", {"frictionloss": 0.064}),
        HiddenEffect("dry_friction@hinge", {"frictionloss": 0.0047}),
        HiddenEffect("asymmetric_friction@slider", {"frictionloss_positive": 0.062, "frictionloss_negative": 0.021}),
        HiddenEffect("quadratic_drag@slider", {"drag": 0.19}),
        HiddenEffect("quadratic_drag@hinge", {"drag": 0.00048}),
        HiddenEffect("joint_stiffness@hinge", {"stiffness": 0.0072}, {"springref": 0.2}),
        HiddenEffect("constant_load@slider", {"load": 0.022}),
        HiddenEffect("armature@hinge", {"armature": 0.00036}),
        HiddenEffect("com_offset@pole", {"z": -0.0072}),
        HiddenEffect("gravity_tilt@world", {"angle": 0.0027}),
        HiddenEffect("actuator_delay@motor", {"delay": 0.005}),
        HiddenEffect("actuator_lag@motor", {"time_constant": 0.005}),
        HiddenEffect("actuator_gain@motor", {"gain": 0.096}),
        HiddenEffect("actuator_dead_zone@motor", {"width": 0.009}),
        HiddenEffect("actuator_saturation@motor", {"limit": 1.4}, shrinks=True),
        HiddenEffect("sensor_scale@qpos.hinge", {"scale": 0.016}),
    ),
    outside=(
        HiddenEffect("detent@hinge", {"amplitude": 0.0079}, {"poles": 6.0, "speed": 1.0}),
        HiddenEffect("periodic@slider", {"amplitude": 0.11}, {"frequency": 1.9, "phase": 0.1}),
        HiddenEffect("flexible_mode@slider", {"mass": 0.24}, {"frequency": 1.0}),
    ),
    ties=(
        Tie(HiddenEffect("back_emf@motor", {"constant": 0.022}), "viscous_friction@slider", ("joint.slider.damping",)),
    ),
    alike=(
        # Force, both inertias and their coupling, up to a common factor: three ratios, of which the masses set two.
        ("actuator_gain@motor", "armature@hinge", "com_offset@pole"),
        ("actuator_delay@motor", "actuator_lag@motor"),
    ),
)


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
        seconds=5.0,
        resolution=(_ENCODER, _ENCODER),
        sd=(1e-3, 1e-3),
        speed_sd=(),
        amplitude=(2.5, 0.8),
        band=(0.2, 2.0),
    ),
    effects=(
        HiddenEffect("dry_friction@shoulder", {"frictionloss": 0.12}),
        HiddenEffect("dry_friction@elbow", {"frictionloss": 0.033}),
        HiddenEffect("stribeck_friction@elbow", {"coulomb": 0.033, "static": 0.066}, {"stribeck_velocity": 0.2}),
        HiddenEffect("load_dependent_friction@shoulder", {"mu": 0.071}),
        HiddenEffect("quadratic_drag@elbow", {"drag": 0.0031}),
        HiddenEffect("joint_stiffness@shoulder", {"stiffness": 0.1}, {"springref": 0.3}),
        HiddenEffect("cubic_stiffness@elbow", {"stiffness3": 0.019}, {"springref": 0.0}),
        HiddenEffect("constant_load@elbow", {"load": 0.0077}),
        HiddenEffect("cogging@elbow", {"amplitude": 0.028}, {"poles": 8.0, "phase": 0.5}),
        HiddenEffect("armature@elbow", {"armature": 0.00062}),
        HiddenEffect("com_offset@fore", {"x": 0.0016}),
        HiddenEffect("backlash@elbow", {"gap": 0.006}, {"rotor": 0.002}),
        HiddenEffect("actuator_gain@shoulder_motor", {"gain": 0.04}),
        HiddenEffect("actuator_delay@shoulder_motor", {"delay": 0.0046}),
        HiddenEffect("actuator_lag@elbow_motor", {"time_constant": 0.0047}),
        HiddenEffect("actuator_saturation@elbow_motor", {"limit": 1.1}, shrinks=True),
        HiddenEffect("thermal_derating@shoulder_motor", {"coefficient": 0.29}, {"time_constant": 2.0}),
        HiddenEffect("sensor_bias@qpos.elbow", {"bias": 0.012}),
        HiddenEffect("sensor_delay@qpos.elbow", {"delay": 0.008}),
    ),
    outside=(
        HiddenEffect("detent@elbow", {"amplitude": 0.053}, {"poles": 5.0, "speed": 1.0}),
        HiddenEffect("periodic@shoulder", {"amplitude": 0.069}, {"frequency": 1.1, "phase": 0.6}),
        HiddenEffect("flexible_mode@shoulder", {"mass": 0.0037}, {"frequency": 1.4}),
    ),
    ties=(
        Tie(
            HiddenEffect("back_emf@shoulder_motor", {"constant": 0.1}),
            "viscous_friction@shoulder",
            ("joint.shoulder.damping",),
        ),
        Tie(
            HiddenEffect("back_emf@elbow_motor", {"constant": 0.03}), "viscous_friction@elbow", ("joint.elbow.damping",)
        ),
    ),
    alike=(
        ("com_offset@fore", "sensor_bias@qpos.elbow"),
        ("actuator_delay@shoulder_motor", "actuator_lag@shoulder_motor"),
        ("actuator_delay@elbow_motor", "actuator_lag@elbow_motor"),
    ),
)


def _arm(values: Values) -> Equations:
    return SixJoint.of(values)


_JOINTS = ("j1", "j2", "j3", "j4", "j5", "j6")

SIX_JOINT_ARM = Rig(
    name="six_joint_arm",
    joints=_JOINTS,
    actuators=tuple(
        Actuator(f"m{k + 1}", k, reference=torque) for k, torque in enumerate((8.0, 20.0, 10.0, 2.0, 2.0, 0.5))
    ),
    nominal={
        **{f"body.link{k + 1}.mass": m for k, m in enumerate((3.0, 4.0, 2.5, 1.2, 1.0, 0.3))},
        **{f"joint.j{k + 1}.damping": d for k, d in enumerate((1.0, 1.0, 0.7, 0.2, 0.2, 0.05))},
        **{f"joint.j{k + 1}.armature": a for k, a in enumerate((0.2, 0.2, 0.15, 0.05, 0.05, 0.02))},
    },
    free={
        "body.link3.mass": (1.0, 6.0),
        "body.link5.mass": (0.3, 3.0),
        **{f"joint.j{k + 1}.damping": (0.0, top) for k, top in enumerate((8.0, 8.0, 5.0, 2.0, 2.0, 0.5))},
    },
    equations=_arm,
    protocol=Protocol(
        step=2e-3,
        period=2,
        jitter=0,
        fit=8,
        held=2,
        seconds=4.0,
        resolution=(1e-4,) * 6,
        sd=(5e-4,) * 6,
        speed_sd=(1e-2,) * 6,
        amplitude=(0.5, 0.35, 0.4, 0.5, 0.5, 0.6),
        feedback=((120.0, 18.0), (300.0, 30.0), (150.0, 15.0), (40.0, 3.0), (40.0, 3.0), (10.0, 0.7)),
        band=(0.2, 1.2),
    ),
    effects=(
        HiddenEffect("dry_friction@j2", {"frictionloss": 0.36}),
        HiddenEffect("dry_friction@j4", {"frictionloss": 0.058}),
        HiddenEffect("dry_friction@j6", {"frictionloss": 0.024}),
        HiddenEffect("stribeck_friction@j1", {"coulomb": 0.34, "static": 0.67}, {"stribeck_velocity": 0.1}),
        HiddenEffect("load_dependent_friction@j3", {"mu": 0.024}),
        HiddenEffect("quadratic_drag@j1", {"drag": 0.4}),
        HiddenEffect("constant_load@j2", {"load": 0.21}),
        HiddenEffect("joint_stiffness@j3", {"stiffness": 0.19}, {"springref": 0.2}),
        HiddenEffect("payload@link6", {"mass": 0.028}),
        HiddenEffect("com_offset@link3", {"x": 0.0073}),
        HiddenEffect("gravity_tilt@world", {"angle": 0.012}),
        HiddenEffect("actuator_gain@m2", {"gain": 0.017}),
        HiddenEffect("actuator_delay@m3", {"delay": 0.001}),
        HiddenEffect("actuator_lag@m1", {"time_constant": 0.014}),
        HiddenEffect("sensor_bias@qpos.j3", {"bias": 0.016}),
    ),
    outside=(
        HiddenEffect("detent@j4", {"amplitude": 0.086}, {"poles": 10.0, "speed": 0.5}),
        HiddenEffect("periodic@j1", {"amplitude": 0.4}, {"frequency": 1.6, "phase": 0.6}),
        HiddenEffect("flexible_mode@j2", {"mass": 0.062}, {"frequency": 1.0}),
    ),
    ties=(Tie(HiddenEffect("back_emf@m1", {"constant": 0.8}), "viscous_friction@j1", ("joint.j1.damping",)),),
    alike=(("actuator_delay@m3", "actuator_lag@m3"), ("actuator_delay@m1", "actuator_lag@m1")),
)
