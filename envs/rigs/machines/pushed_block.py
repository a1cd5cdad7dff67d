"""A block on a rough table, pushed along x under a position controller:  m a = g u - d v - mu m g sign(v).

It is pushed slowly. MuJoCo's contacts lift what slides fast (its relaxation of the friction cone): the block would hop,
and its path be chaotic.
"""

from __future__ import annotations

from envs.rigs.drive import Actuator
from envs.rigs.equations import Equations, Translation, Values
from envs.rigs.off_numbers import OffNumber
from envs.rigs.rig import HiddenEffect, Protocol, Rig, Tie


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
        period=4,
        jitter=0,
        fit=8,
        held=2,
        seconds=4.2,
        resolution=(1e-5, 1e-5),
        sd=(3e-4, 1e-3),
        speed_sd=(),
        amplitude=(0.08,),
        feedback=((150.0, 12.0),),
        band=(0.2, 0.6),
    ),
    effects=(
        HiddenEffect("contact_friction@block", {"friction": 0.05}, neutral=0.3),
        HiddenEffect("quadratic_drag@along", {"drag": 0.3}),
        HiddenEffect("joint_stiffness@along", {"stiffness": 2.5}, {"springref": 0.0}),
        HiddenEffect("constant_load@along", {"load": 0.1}),
        HiddenEffect("actuator_delay@pusher", {"delay": 0.004}),
        HiddenEffect("actuator_saturation@pusher", {"limit": 22.0}, shrinks=True),
    ),
    outside=(
        HiddenEffect("periodic@along", {"amplitude": 0.83}, {"frequency": 2.3, "phase": 0.2}),
        HiddenEffect("flexible_mode@along", {"mass": 0.075}, {"frequency": 1.5}),
    ),
    ties=(Tie(HiddenEffect("contact_friction@block", {"friction": 0.05}, neutral=0.3), "dry_friction@along"),),
    alike=(
        # With the motor's gear free a scale s of the position is 1 + s times the gear and the friction.
        ("contact_friction@block", "dry_friction@along", "sensor_scale@qpos.along"),
        ("constant_load@along", "gravity_tilt@world"),
        ("actuator_delay@pusher", "actuator_lag@pusher", "sensor_delay@qpos.along"),
    ),
    surplus=(OffNumber("joint.along.stiffness", "joint_stiffness@along", 2.5),),
)
