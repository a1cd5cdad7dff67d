"""A motor, a ball screw and a carriage: dry friction, then a constant load.

The benchmark's authors published 95.1 kg, 203.5 N s/m, 20.4 N of dry friction and 3.16 N of load.
"""

from __future__ import annotations

from pathlib import Path

from onlinebayes.runs import Row
from recipes.studies.measured_rows import refine

NAME = "emps"
WANTED = ("dry_friction@carriage", "constant_load@carriage")
SIGNAL = "qpos.carriage"


def judge(data: Path) -> tuple[Row, ...]:
    """Refine the problem and hold it against what was published."""
    refined = refine(NAME, data)
    goal, named = "dry_friction, then constant_load", refined.accepted[:2] == WANTED
    left = refined.error("after", SIGNAL) / refined.error("before", SIGNAL)
    return (
        *refined.rows(goal, named, {SIGNAL: "m"}, longest=30.0),
        Row(f"{NAME}: {SIGNAL}, after over before", left, goal="<= 0.4", holds=left <= 0.4),
    )
