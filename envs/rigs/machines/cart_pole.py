"""A cart on a rail under a position controller, a pole hanging from it; equations in :class:`CartPole`."""

from __future__ import annotations

import math

from envs.rigs.drive import Actuator
from envs.rigs.equations import CartPole, Equations, Lever, Values, mass
from envs.rigs.off_numbers import OffNumber
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
        seconds=4.2,
        resolution=(1e-5, _ENCODER),
        sd=(1e-4, 5e-4),
        speed_sd=(2e-3, 1e-2),
        amplitude=(0.12,),
        feedback=((6.0, 0.8),),
        band=(0.2, 1.2),
    ),
    effects=(
        HiddenEffect("dry_friction@slider", {"frictionloss": 0.025}),
        HiddenEffect("dry_friction@hinge", {"frictionloss": 0.0017}),
        HiddenEffect("asymmetric_friction@slider", {"frictionloss_positive": 0.024, "frictionloss_negative": 0.008}),
        HiddenEffect("quadratic_drag@slider", {"drag": 0.15}),
        HiddenEffect("quadratic_drag@hinge", {"drag": 0.00019}),
        HiddenEffect("joint_stiffness@hinge", {"stiffness": 0.004}, {"springref": 0.2}),
        HiddenEffect("constant_load@slider", {"load": 0.01}),
        HiddenEffect("armature@hinge", {"armature": 0.00016}),
        HiddenEffect("com_offset@pole", {"z": -0.0032}),
        HiddenEffect("gravity_tilt@world", {"angle": 0.0015}),
        HiddenEffect("actuator_delay@motor", {"delay": 0.0039}),
        HiddenEffect("actuator_lag@motor", {"time_constant": 0.0039}),
        HiddenEffect("actuator_gain@motor", {"gain": 0.043}),
        HiddenEffect("actuator_dead_zone@motor", {"width": 0.004}),
        HiddenEffect("actuator_saturation@motor", {"limit": 1.8}, shrinks=True),
        HiddenEffect("sensor_scale@qpos.hinge", {"scale": 0.0072}),
    ),
    outside=(
        HiddenEffect("detent@hinge", {"amplitude": 0.0036}, {"poles": 6.0, "speed": 1.0}),
        HiddenEffect("periodic@slider", {"amplitude": 0.05}, {"frequency": 1.9, "phase": 0.1}),
        HiddenEffect("flexible_mode@slider", {"mass": 0.11}, {"frequency": 1.0}),
    ),
    ties=(
        Tie(HiddenEffect("back_emf@motor", {"constant": 0.0099}), "viscous_friction@slider", ("joint.slider.damping",)),
    ),
    alike=(
        # Force, both inertias and their coupling, up to a common factor: three ratios, of which the masses set two.
        ("actuator_gain@motor", "armature@hinge", "com_offset@pole"),
        ("com_offset@pole.x", "sensor_bias@qpos.hinge"),
        ("actuator_delay@motor", "actuator_lag@motor"),
    ),
    surplus=(
        OffNumber("joint.slider.frictionloss", "dry_friction@slider", 0.024),
        OffNumber("joint.hinge.frictionloss", "dry_friction@hinge", 0.0015),
        OffNumber("joint.hinge.stiffness", "joint_stiffness@hinge", 0.003),
        OffNumber("joint.slider.stiffness", "joint_stiffness@slider", 0.3),
    ),
    own=(
        OffNumber("body.pole.ipos[0]", "com_offset@pole.x", 0.00054),
        OffNumber("body.pole.ipos[2]", "com_offset@pole.z", 0.0024),
        OffNumber("actuator.motor.gear[0]", "actuator_gain@motor", 0.16),
    ),
    moments={"body.pole.inertia[1]": "armature@hinge"},
)
