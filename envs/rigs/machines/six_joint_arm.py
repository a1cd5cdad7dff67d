"""A six-joint arm on a pedestal under position controllers; equations in :mod:`envs.rigs.chain`."""

from __future__ import annotations

from envs.rigs.chain import SixJoint
from envs.rigs.drive import Actuator
from envs.rigs.equations import Equations, Values
from envs.rigs.off_numbers import OffNumber
from envs.rigs.rig import HiddenEffect, Protocol, Rig, Tie


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
        period=5,
        jitter=0,
        fit=8,
        held=2,
        seconds=3.2,
        resolution=(1e-4,) * 6,
        sd=(5e-4,) * 6,
        speed_sd=(1e-2,) * 6,
        amplitude=(0.5, 0.35, 0.4, 0.5, 0.5, 0.6),
        feedback=((120.0, 18.0), (300.0, 30.0), (150.0, 15.0), (40.0, 3.0), (40.0, 3.0), (10.0, 0.7)),
        band=(0.2, 1.2),
    ),
    effects=(
        HiddenEffect("dry_friction@j2", {"frictionloss": 1.3}),
        HiddenEffect("dry_friction@j4", {"frictionloss": 0.21}),
        HiddenEffect("dry_friction@j6", {"frictionloss": 0.086}),
        HiddenEffect("stribeck_friction@j1", {"coulomb": 1.2, "static": 2.4}, {"stribeck_velocity": 0.1}),
        HiddenEffect("load_dependent_friction@j3", {"mu": 0.086}),
        HiddenEffect("quadratic_drag@j1", {"drag": 0.84}),
        HiddenEffect("constant_load@j2", {"load": 0.45}),
        HiddenEffect("joint_stiffness@j3", {"stiffness": 0.4}, {"springref": 0.2}),
        HiddenEffect("payload@link6", {"mass": 0.075}),
        HiddenEffect("com_offset@link3", {"x": 0.015}),
        HiddenEffect("gravity_tilt@world", {"angle": 0.025}),
        HiddenEffect("actuator_gain@m2", {"gain": 0.036}),
        HiddenEffect("actuator_lag@m1", {"time_constant": 0.0095}),
        HiddenEffect("sensor_bias@qpos.j3", {"bias": 0.028}),
    ),
    outside=(
        HiddenEffect("detent@j4", {"amplitude": 0.18}, {"poles": 10.0, "speed": 0.5}),
        HiddenEffect("periodic@j1", {"amplitude": 0.84}, {"frequency": 1.6, "phase": 0.6}),
        HiddenEffect("flexible_mode@j2", {"mass": 0.13}, {"frequency": 1.0}),
    ),
    ties=(Tie(HiddenEffect("back_emf@m1", {"constant": 1.7}), "viscous_friction@j1", ("joint.j1.damping",)),),
    alike=(("actuator_delay@m1", "actuator_lag@m1"),),
    surplus=(
        OffNumber("joint.j2.frictionloss", "dry_friction@j2", 1.3),
        OffNumber("joint.j4.frictionloss", "dry_friction@j4", 0.21),
        OffNumber("joint.j6.frictionloss", "dry_friction@j6", 0.086),
        OffNumber("joint.j3.stiffness", "joint_stiffness@j3", 1.0),
    ),
    own=(
        OffNumber("body.link3.ipos[0]", "com_offset@link3.x", 0.015),
        OffNumber("actuator.m2.gear[0]", "actuator_gain@m2", 0.036),
        OffNumber("joint.j4.armature", "armature@j4", 0.0048),
    ),
)
