"""A ball seen by cameras in flight, two small jets on it:  m a = u + m g; it does not spin."""

from __future__ import annotations

from envs.rigs.drive import Actuator
from envs.rigs.equations import Equations, Translation, Values
from envs.rigs.off_numbers import OffNumber
from envs.rigs.rig import HiddenEffect, Protocol, Rig, Tie


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
        HiddenEffect("gravity_tilt@world", {"angle": 0.015}),
        HiddenEffect("constant_load@y", {"load": 0.023}),
        HiddenEffect("actuator_gain@jet_y", {"gain": 0.21}),
        HiddenEffect("actuator_lag@jet_x", {"time_constant": 0.079}),
        HiddenEffect("actuator_delay@jet_x", {"delay": 0.06}),
        HiddenEffect("viscous_friction@x", {"damping": 0.036}),
    ),
    last=(HiddenEffect("wind@world", {"drag": 3.9e-05}, {"x": 3.0}),),
    outside=(
        HiddenEffect("periodic@x", {"amplitude": 0.075}, {"frequency": 2.7, "phase": 0.4}),
        HiddenEffect("flexible_mode@y", {"mass": 0.028}, {"frequency": 1.3}),
    ),
    ties=(Tie(HiddenEffect("back_emf@jet_x", {"constant": 0.036}), "viscous_friction@x"),),
    alike=(
        ("wind@world", "wind@ball"),
        ("constant_load@x", "gravity_tilt@world"),
        ("constant_load@y", "gravity_tilt@world.y"),
        ("viscous_friction@x", "back_emf@jet_x"),
        # Nothing but the jets knows x: late jets are late cameras.
        ("actuator_delay@jet_x", "sensor_delay@qpos.x"),
        # The mass is known by the jets alone, which have one ratio to show: what y has of its own, or x.
        (
            *("actuator_gain@jet_x", "actuator_gain@jet_y", "sensor_scale@qpos.x", "sensor_scale@qpos.y"),
            *("armature@x", "armature@y"),
        ),
    ),
    surplus=(
        OffNumber("joint.x.damping", "viscous_friction@x", 0.026),
        OffNumber("joint.y.frictionloss", "dry_friction@y", 0.025),
        OffNumber("joint.z.stiffness", "joint_stiffness@z", 0.00025),
    ),
    own=(OffNumber("actuator.jet_y.gear[0]", "actuator_gain@jet_y", 0.13),),
)
