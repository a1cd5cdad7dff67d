"""A hobby servo that swings a loaded horn:  (I + J + m l^2) a = kp (u - q) - (kv + d) v - m g l sin q."""

from __future__ import annotations

import math

from envs.rigs.drive import Actuator
from envs.rigs.equations import Equations, Lever, Values
from envs.rigs.off_numbers import OffNumber
from envs.rigs.rig import HiddenEffect, Protocol, Rig, Tie

_ENCODER = 2 * math.pi / 4096  # [rad]


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
        seconds=4.2,
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
        HiddenEffect("backlash@horn", {"gap": 0.006}, {"rotor": 0.004}),
        HiddenEffect("com_offset@load", {"x": 0.0032}),
        HiddenEffect("actuator_delay@servo", {"delay": 0.0017}),
        HiddenEffect("actuator_lag@servo", {"time_constant": 0.002}),
        HiddenEffect("actuator_dead_zone@servo", {"width": 0.0051}),
        HiddenEffect("actuator_saturation@servo", {"limit": 1.6}, shrinks=True),
        HiddenEffect("sensor_bias@qpos.horn", {"bias": 0.0019}),
    ),
    last=(HiddenEffect("parameter_step@joint.horn.damping", {"size": 0.028}, {"time": 2.0}),),
    outside=(
        HiddenEffect("detent@horn", {"amplitude": 0.052}, {"poles": 9.0, "speed": 1.0}),
        HiddenEffect("hysteresis@horn", {"amplitude": 0.058}, {"width": 0.5}),
        HiddenEffect("flexible_mode@horn", {"mass": 0.00077}, {"frequency": 2.2}),
    ),
    ties=(Tie(HiddenEffect("back_emf@servo", {"constant": 0.071}), "viscous_friction@horn", ("joint.horn.damping",)),),
    alike=(
        ("com_offset@load", "gravity_tilt@world"),
        # With the mass free: inertia over weight, or over what the servo gives.
        ("armature@horn", "com_offset@load.z", "actuator_gain@servo", "actuator.servo.kv"),
        # The velocities tell a late sensor of the angle from a late servo.
        ("actuator_delay@servo", "actuator_lag@servo"),
        # kp b against kp b + m g l b cos q: a hundredth of it.
        ("constant_load@horn", "sensor_bias@qpos.horn"),
    ),
    surplus=(OffNumber("joint.horn.frictionloss", "dry_friction@horn", 0.017),),
    own=(
        OffNumber("body.load.ipos[0]", "com_offset@load.x", 0.0031),
        OffNumber("joint.horn.armature", "armature@horn", 0.00072),
    ),
    moments={"body.load.inertia[1]": "armature@horn"},
)
