"""A carriage on a rail, driven by a spindle under a position controller:  m a = g u - d v."""

from __future__ import annotations

from envs.rigs.drive import Actuator
from envs.rigs.equations import Equations, Translation, Values
from envs.rigs.off_numbers import OffNumber
from envs.rigs.rig import HiddenEffect, Protocol, Rig, Tie


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
        period=4,
        jitter=0,
        fit=8,
        held=2,
        seconds=4.0,
        resolution=(1e-5,),
        sd=(1e-4,),
        speed_sd=(),
        amplitude=(0.12,),
        feedback=((40.0, 3.0),),
        band=(0.2, 2.0),
    ),
    effects=(
        HiddenEffect("dry_friction@carriage", {"frictionloss": 0.54}),
        HiddenEffect("asymmetric_friction@carriage", {"frictionloss_positive": 0.36, "frictionloss_negative": 0.12}),
        HiddenEffect("stribeck_friction@carriage", {"coulomb": 0.38, "static": 0.74}, {"stribeck_velocity": 0.05}),
        HiddenEffect("load_dependent_friction@carriage", {"mu": 0.023}),
        HiddenEffect("quadratic_drag@carriage", {"drag": 0.79}),
        HiddenEffect("joint_stiffness@carriage", {"stiffness": 4.7}, {"springref": 0.02}),
        HiddenEffect("constant_load@carriage", {"load": 0.16}),
        HiddenEffect("gravity_tilt@world", {"angle": 0.0029}),
        HiddenEffect("actuator_delay@motor", {"delay": 0.002}),
        HiddenEffect("actuator_lag@motor", {"time_constant": 0.002}),
        HiddenEffect("actuator_dead_zone@motor", {"width": 0.027}),
        HiddenEffect("actuator_saturation@motor", {"limit": 4.2}, shrinks=True),
        HiddenEffect("thermal_derating@motor", {"coefficient": 0.029}, {"time_constant": 2.0}),
        HiddenEffect("sensor_delay@qpos.carriage", {"delay": 0.0043}),
    ),
    last=(
        HiddenEffect("cogging@carriage", {"amplitude": 0.77}, {"poles": 120.0, "phase": 0.7}),
        HiddenEffect("parameter_step@joint.carriage.damping", {"size": 5.4}, {"time": 2.0}),
        HiddenEffect("parameter_drift@joint.carriage.damping", {"rate": 1.8}),
    ),
    by_name=(HiddenEffect("backlash@carriage", {"gap": 0.035}, {"rotor": 1.0}),),
    outside=(
        HiddenEffect("flexible_mode@carriage", {"mass": 1.8}, {"frequency": 1.5}),
        HiddenEffect("periodic@carriage", {"amplitude": 1.1}, {"frequency": 1.7, "phase": 0.3}),
        HiddenEffect("hysteresis@carriage", {"amplitude": 1.1}, {"width": 0.08}),
    ),
    ties=(
        Tie(
            HiddenEffect("back_emf@motor", {"constant": 0.018}),
            "viscous_friction@carriage",
            ("joint.carriage.damping",),
        ),
        Tie(HiddenEffect("payload@carriage", {"mass": 2.0}), "armature@carriage", ("body.carriage.mass",)),
    ),
    alike=(
        ("constant_load@carriage", "gravity_tilt@world"),
        ("actuator_delay@motor", "actuator_lag@motor", "sensor_delay@qpos.carriage"),
        # Where the mass is fixed, with the damping free: m a = g u - d v up to a common factor.
        ("payload@carriage", "armature@carriage", "actuator_gain@motor", "sensor_scale@qpos.carriage"),
    ),
    surplus=(
        OffNumber("joint.carriage.frictionloss", "dry_friction@carriage", 0.61),
        # With the mass free, a stronger motor on a heavier carriage makes little of a spring.
        OffNumber("joint.carriage.stiffness", "joint_stiffness@carriage", 2.4, fixed=("body.carriage.mass",)),
    ),
    own=(OffNumber("body.carriage.mass", "payload@carriage", 0.07, fixed=("body.carriage.mass",)),),
)
