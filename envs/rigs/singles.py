"""The rigs with one moving part: a slide drive, a swinging bob, a position servo, a pushed block, a thrown ball."""

from __future__ import annotations

import math

from envs.rigs.drive import Actuator
from envs.rigs.equations import Equations, Lever, Translation, Values
from envs.rigs.rig import HiddenEffect, Protocol, Rig, Tie

_ENCODER = 2 * math.pi / 4096  # [rad]


def _carriage(values: Values) -> Equations:
    return Translation.of(values, "carriage", "x")


SLIDE_DRIVE = Rig(
    name="slide_drive",
    joints=("carriage",),
    actuators=(Actuator("motor", 0, reference=2.0),),
    nominal={"body.carriage.mass": 6.0, "joint.carriage.damping": 12.0, "actuator.motor.gear[0]": 20.0},
    free={"body.carriage.mass": (2.0, 15.0), "joint.carriage.damping": (0.0, 80.0)},
    equations=_carriage,
    protocol=Protocol(
        step=1e-3,
        period=1,
        jitter=0,
        fit=8,
        held=2,
        seconds=5.0,
        resolution=(1e-5,),
        sd=(1e-4,),
        speed_sd=(),
        amplitude=(0.12,),
        feedback=((40.0, 3.0),),
        band=(0.2, 2.0),
    ),
    effects=(
        HiddenEffect("dry_friction@carriage", {"frictionloss": 0.3}),
        HiddenEffect("asymmetric_friction@carriage", {"frictionloss_positive": 0.2, "frictionloss_negative": 0.069}),
        HiddenEffect("stribeck_friction@carriage", {"coulomb": 0.21, "static": 0.41}, {"stribeck_velocity": 0.05}),
        HiddenEffect("load_dependent_friction@carriage", {"mu": 0.013}),
        HiddenEffect("quadratic_drag@carriage", {"drag": 0.44}),
        HiddenEffect("joint_stiffness@carriage", {"stiffness": 2.6}, {"springref": 0.02}),
        HiddenEffect("constant_load@carriage", {"load": 0.089}),
        HiddenEffect("cogging@carriage", {"amplitude": 0.43}, {"poles": 120.0, "phase": 0.7}),
        HiddenEffect("gravity_tilt@world", {"angle": 0.0016}),
        HiddenEffect("backlash@carriage", {"gap": 8e-3}, {"rotor": 1.0}),
        HiddenEffect("actuator_delay@motor", {"delay": 0.0011}),
        HiddenEffect("actuator_lag@motor", {"time_constant": 0.0011}),
        HiddenEffect("actuator_dead_zone@motor", {"width": 0.015}),
        HiddenEffect("actuator_saturation@motor", {"limit": 5.0}, shrinks=True),
        HiddenEffect("thermal_derating@motor", {"coefficient": 0.016}, {"time_constant": 2.0}),
        HiddenEffect("sensor_delay@qpos.carriage", {"delay": 0.0024}),
        HiddenEffect("parameter_step@joint.carriage.damping", {"size": 3.0}, {"time": 2.5}),
        HiddenEffect("parameter_drift@joint.carriage.damping", {"rate": 1.0}),
    ),
    outside=(
        HiddenEffect("flexible_mode@carriage", {"mass": 0.99}, {"frequency": 1.5}),
        HiddenEffect("periodic@carriage", {"amplitude": 0.62}, {"frequency": 1.7, "phase": 0.3}),
        HiddenEffect("hysteresis@carriage", {"amplitude": 0.63}, {"width": 0.08}),
    ),
    ties=(
        Tie(
            HiddenEffect("back_emf@motor", {"constant": 0.01}), "viscous_friction@carriage", ("joint.carriage.damping",)
        ),
        Tie(HiddenEffect("payload@carriage", {"mass": 1.1}), "armature@carriage", ("body.carriage.mass",)),
    ),
    alike=(
        ("constant_load@carriage", "gravity_tilt@world"),
        ("actuator_delay@motor", "actuator_lag@motor", "sensor_delay@qpos.carriage"),
    ),
)


def _bob(values: Values) -> Equations:
    return Lever.of(values, "bob", 0.35, 0.001)


SWING = Rig(
    name="swing",
    joints=("hinge",),
    actuators=(Actuator("motor", 0, reference=0.5),),
    nominal={"body.bob.mass": 0.6, "joint.hinge.damping": 0.03},
    free={"body.bob.mass": (0.2, 1.5), "joint.hinge.damping": (0.0, 0.2)},
    equations=_bob,
    protocol=Protocol(
        step=1e-3,
        period=5,
        jitter=1,
        fit=8,
        held=2,
        seconds=6.0,
        resolution=(_ENCODER,),
        sd=(8e-4,),
        speed_sd=(),
        amplitude=(0.5,),
        band=(0.2, 2.5),
    ),
    effects=(
        HiddenEffect("dry_friction@hinge", {"frictionloss": 0.011}),
        HiddenEffect("stribeck_friction@hinge", {"coulomb": 0.0074, "static": 0.015}, {"stribeck_velocity": 0.3}),
        HiddenEffect("quadratic_drag@hinge", {"drag": 0.0081}),
        HiddenEffect("joint_stiffness@hinge", {"stiffness": 0.0091}, {"springref": 0.4}),
        HiddenEffect("cubic_stiffness@hinge", {"stiffness3": 0.075}, {"springref": 0.0}),
        HiddenEffect("constant_load@hinge", {"load": 0.0048}),
        HiddenEffect("cogging@hinge", {"amplitude": 0.01}, {"poles": 7.0, "phase": 0.5}),
        HiddenEffect("armature@hinge", {"armature": 0.00054}),
        HiddenEffect("com_offset@bob", {"x": 0.001}),
        HiddenEffect("actuator_delay@motor", {"delay": 0.0035}),
        HiddenEffect("actuator_lag@motor", {"time_constant": 0.0035}),
        HiddenEffect("actuator_saturation@motor", {"limit": 1}, shrinks=True),
        HiddenEffect("sensor_bias@qpos.hinge", {"bias": 0.003}),
        HiddenEffect("sensor_delay@qpos.hinge", {"delay": 0.0035}),
    ),
    outside=(
        HiddenEffect("detent@hinge", {"amplitude": 0.036}, {"poles": 4.0, "speed": 1.0}),
        HiddenEffect("periodic@hinge", {"amplitude": 0.033}, {"frequency": 1.3, "phase": 0.9}),
        HiddenEffect("flexible_mode@hinge", {"mass": 0.0028}, {"frequency": 1.8}),
    ),
    ties=(
        Tie(HiddenEffect("back_emf@motor", {"constant": 0.004}), "viscous_friction@hinge", ("joint.hinge.damping",)),
        Tie(HiddenEffect("gravity_tilt@world", {"angle": 0.003}), "sensor_bias@qpos.hinge"),
    ),
    alike=(
        ("com_offset@bob", "gravity_tilt@world.x", "sensor_bias@qpos.hinge"),
        # Inertia over weight; a tilt along the hinge's axis takes weight away.
        ("armature@hinge", "com_offset@bob.z", "gravity_tilt@world.y"),
        ("actuator_delay@motor", "sensor_delay@qpos.hinge"),
    ),
)


def _load(values: Values) -> Equations:
    return Lever.of(values, "load", 0.12, 0.0008)


POSITION_SERVO = Rig(
    name="position_servo",
    joints=("horn",),
    actuators=(Actuator("servo", 0, reference=0.5, servo=True),),
    nominal={
        "body.load.mass": 0.35,
        "joint.horn.damping": 0.02,
        "joint.horn.armature": 0.004,
        "actuator.servo.kp": 4.0,
        "actuator.servo.kv": 0.25,
    },
    free={"body.load.mass": (0.1, 1.0), "joint.horn.damping": (0.0, 0.5), "actuator.servo.kp": (1.0, 12.0)},
    equations=_load,
    protocol=Protocol(
        step=1e-3,
        period=4,
        jitter=0,
        fit=8,
        held=2,
        seconds=5.0,
        resolution=(_ENCODER,),
        sd=(3e-4,),
        speed_sd=(0.02,),
        amplitude=(0.8,),
        band=(0.2, 3.0),
    ),
    effects=(
        HiddenEffect("dry_friction@horn", {"frictionloss": 0.018}),
        HiddenEffect("asymmetric_friction@horn", {"frictionloss_positive": 0.02, "frictionloss_negative": 0.0083}),
        HiddenEffect("load_dependent_friction@horn", {"mu": 0.046}),
        HiddenEffect("joint_stiffness@horn", {"stiffness": 0.035}, {"springref": 0.3}),
        HiddenEffect("constant_load@horn", {"load": 0.011}),
        HiddenEffect("backlash@horn", {"gap": 0.0013}, {"rotor": 0.004}),
        HiddenEffect("com_offset@load", {"x": 0.0032}),
        HiddenEffect("actuator_delay@servo", {"delay": 0.0017}),
        HiddenEffect("actuator_lag@servo", {"time_constant": 0.002}),
        HiddenEffect("actuator_dead_zone@servo", {"width": 0.0051}),
        HiddenEffect("actuator_saturation@servo", {"limit": 1.6}, shrinks=True),
        HiddenEffect("sensor_bias@qpos.horn", {"bias": 0.0019}),
        HiddenEffect("parameter_step@joint.horn.damping", {"size": 0.028}, {"time": 2.5}),
    ),
    outside=(
        HiddenEffect("detent@horn", {"amplitude": 0.052}, {"poles": 9.0, "speed": 1.0}),
        HiddenEffect("hysteresis@horn", {"amplitude": 0.058}, {"width": 0.5}),
        HiddenEffect("flexible_mode@horn", {"mass": 0.00077}, {"frequency": 2.2}),
    ),
    ties=(Tie(HiddenEffect("back_emf@servo", {"constant": 0.071}), "viscous_friction@horn", ("joint.horn.damping",)),),
    alike=(
        ("com_offset@load", "gravity_tilt@world"),
        # The velocities tell a late sensor of the angle from a late servo.
        ("actuator_delay@servo", "actuator_lag@servo"),
        # kp b against kp b + m g l b cos q: a hundredth of it.
        ("constant_load@horn", "sensor_bias@qpos.horn"),
    ),
)


def _block(values: Values) -> Equations:
    return Translation.of(values, "block", "xz", values.get("contact_friction@block.friction", 0.3))


PUSHED_BLOCK = Rig(
    name="pushed_block",
    joints=("along", "lift"),
    actuators=(Actuator("pusher", 0, reference=6.0),),
    nominal={"body.block.mass": 1.5, "joint.along.damping": 0.5, "actuator.pusher.gear[0]": 1.0},
    free={"joint.along.damping": (0.0, 5.0), "actuator.pusher.gear[0]": (0.5, 2.0)},
    equations=_block,
    protocol=Protocol(
        step=1e-3,
        period=2,
        jitter=0,
        fit=8,
        held=2,
        seconds=4.0,
        resolution=(1e-5, 1e-5),
        sd=(3e-4, 1e-3),
        speed_sd=(),
        amplitude=(0.15,),
        feedback=((150.0, 12.0),),
        band=(0.3, 2.0),
    ),
    effects=(
        HiddenEffect("contact_friction@block", {"friction": 0.018}, neutral=0.3),
        HiddenEffect("quadratic_drag@along", {"drag": 0.21}),
        HiddenEffect("joint_stiffness@along", {"stiffness": 1.8}, {"springref": 0.0}),
        HiddenEffect("constant_load@along", {"load": 0.071}),
        HiddenEffect("actuator_delay@pusher", {"delay": 0.0029}),
        HiddenEffect("actuator_saturation@pusher", {"limit": 24.0}, shrinks=True),
    ),
    outside=(
        HiddenEffect("periodic@along", {"amplitude": 0.59}, {"frequency": 2.3, "phase": 0.2}),
        HiddenEffect("flexible_mode@along", {"mass": 0.053}, {"frequency": 1.5}),
    ),
    ties=(Tie(HiddenEffect("contact_friction@block", {"friction": 0.018}, neutral=0.3), "dry_friction@along"),),
    alike=(
        ("contact_friction@block", "dry_friction@along"),
        ("constant_load@along", "gravity_tilt@world"),
        ("actuator_delay@pusher", "actuator_lag@pusher", "sensor_delay@qpos.along"),
    ),
)


def _ball(values: Values) -> Equations:
    return Translation.of(values, "ball", "xyz")


THROWN_BALL = Rig(
    name="thrown_ball",
    joints=("x", "y", "z"),
    actuators=(Actuator("jet_x", 0, reference=0.5), Actuator("jet_y", 1, reference=0.5)),
    nominal={"body.ball.mass": 0.15},
    free={"body.ball.mass": (0.05, 0.5)},
    equations=_ball,
    protocol=Protocol(
        step=1e-3,
        period=5,
        jitter=1,
        fit=10,
        held=2,
        seconds=2.0,
        resolution=(1e-4, 1e-4, 1e-4),
        sd=(5e-4, 5e-4, 5e-4),
        speed_sd=(),
        amplitude=(0.6, 0.6),
        band=(0.5, 2.0),
        start=(3.0, 3.0, 8.0),
    ),
    effects=(
        HiddenEffect("air_drag@ball", {"drag": 4e-05}),
        HiddenEffect("wind@world", {"drag": 3.9e-05}, {"x": 3.0}),
        HiddenEffect("gravity_tilt@world", {"angle": 0.015}),
        HiddenEffect("constant_load@y", {"load": 0.023}),
        HiddenEffect("actuator_gain@jet_y", {"gain": 0.21}),
        HiddenEffect("actuator_lag@jet_x", {"time_constant": 0.079}),
        HiddenEffect("actuator_delay@jet_x", {"delay": 0.06}),
        HiddenEffect("viscous_friction@x", {"damping": 0.036}),
    ),
    outside=(
        HiddenEffect("periodic@x", {"amplitude": 0.075}, {"frequency": 2.7, "phase": 0.4}),
        HiddenEffect("flexible_mode@y", {"mass": 0.028}, {"frequency": 1.3}),
    ),
    ties=(Tie(HiddenEffect("back_emf@jet_x", {"constant": 0.036}), "viscous_friction@x"),),
    alike=(
        ("constant_load@x", "gravity_tilt@world"),
        ("constant_load@y", "gravity_tilt@world.y"),
        ("viscous_friction@x", "back_emf@jet_x"),
    ),
)
