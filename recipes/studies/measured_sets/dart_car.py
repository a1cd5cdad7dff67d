"""A 1/10 scale car: friction and dead zone on a straight, tyres that saturate in circles, grip that differs by floor.

``floor`` asks about a parameter and no law: its goal is a grip that differs and no effect that is accepted.
"""

from __future__ import annotations

from pathlib import Path

from onlinebayes.runs import Row
from recipes.studies.measured_rows import refine

DRIVE = ("dry_friction@car", "actuator_dead_zone@throttle")
TYRE = "tyre_saturation@front"
POSE = {"qpos.yaw": "rad", "qpos.x": "m", "qpos.y": "m"}


def judge(data: Path) -> tuple[Row, ...]:
    """Refine the three problems."""
    straight = refine("dart_car/longitudinal", data)
    named = bool(set(DRIVE) & set(straight.accepted)) and set(straight.accepted) <= set(DRIVE)
    rows = list(straight.rows("dry friction, a dead zone, or both; nothing else", named, {"qvel.car": "m/s"}))
    circles = refine("dart_car/lateral", data)
    rows += circles.rows(f"{TYRE} first", circles.accepted[:1] == (TYRE,), POSE)
    floors = refine("dart_car/floor", data)
    rows += floors.rows("no further effect", not floors.accepted, POSE)
    for address, value in floors.report["parameters"].items():
        if address.startswith("grip"):
            apart = value["q95"] < 1.0
            rows.append(Row(f"{floors.name}: {address}, 95 %", value["q95"], goal="below rubber's 1", holds=apart))
    return tuple(rows)
