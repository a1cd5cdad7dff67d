"""A bob on a light rod, driven at the hinge:  (I + m l^2) a = u - d v - m g l sin q."""

from __future__ import annotations

import math

from envs.rigs.drive import Actuator
from envs.rigs.equations import Equations, Lever, Values
from envs.rigs.off_numbers import OffNumber
from envs.rigs.rig import HiddenEffect, Protocol, Rig, Tie

_ENCODER = 2 * math.pi / 4096  # [rad]


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
        HiddenEffect("armature@hinge", {"armature": 0.00054}),
        HiddenEffect("com_offset@bob", {"x": 0.001}),
        HiddenEffect("actuator_delay@motor", {"delay": 0.0035}),
        HiddenEffect("actuator_lag@motor", {"time_constant": 0.0035}),
        HiddenEffect("actuator_saturation@motor", {"limit": 1}, shrinks=True),
        HiddenEffect("sensor_bias@qpos.hinge", {"bias": 0.003}),
        HiddenEffect("sensor_delay@qpos.hinge", {"delay": 0.0035}),
    ),
    last=(HiddenEffect("cogging@hinge", {"amplitude": 0.01}, {"poles": 7.0, "phase": 0.5}),),
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
        # Inertia over weight; a tilt along the hinge's axis takes weight away. With the mass free, so does a gain.
        ("armature@hinge", "com_offset@bob.z", "gravity_tilt@world.y", "actuator_gain@motor"),
        # A lag of milliseconds is a delay: they part by (2 pi f T)^2 / 2, a thousandth at the highest frequency.
        ("actuator_delay@motor", "actuator_lag@motor", "sensor_delay@qpos.hinge"),
    ),
    surplus=(
        OffNumber("joint.hinge.frictionloss", "dry_friction@hinge", 0.011),
        OffNumber("joint.hinge.armature", "armature@hinge", 0.00053),
    ),
    own=(
        OffNumber("body.bob.ipos[0]", "com_offset@bob.x", 0.001),
        OffNumber("body.bob.ipos[2]", "com_offset@bob.z", 0.0027),
    ),
    moments={"body.bob.inertia[1]": "armature@hinge"},
)
