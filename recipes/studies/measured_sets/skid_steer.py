"""A skid-steered vehicle: commands that were written down for another one, and a driver that ramps its turns."""

from __future__ import annotations

from pathlib import Path

from onlinebayes.runs import Row
from recipes.studies.measured_rows import refine

POSE = {"qpos.x": "m", "qpos.y": "m", "qpos.yaw": "rad"}
SPEEDS = {"qvel.yaw": "rad/s", "qvel.left": "rad/s", "qvel.right": "rad/s"}


def judge(data: Path) -> tuple[Row, ...]:
    """Refine the problem; what its wheels were told must not be blamed on the actuators."""
    refined = refine("skid_steer", data)
    blamed = [effect for effect in refined.accepted if effect.startswith("actuator_")]
    return refined.rows("no effect on an actuator", not blamed, {**POSE, **SPEEDS})
