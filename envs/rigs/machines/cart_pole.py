"""A cart on a rail under a position controller, a pole hanging from it; equations in :class:`CartPole`."""

from __future__ import annotations

import math

from envs.rigs.drive import Actuator
from envs.rigs.equations import CartPole, Equations, Lever, Values, mass
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
