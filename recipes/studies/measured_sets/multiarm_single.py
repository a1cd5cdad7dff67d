"""A free pendulum: dry friction and quadratic drag, each invisible without the other."""

from __future__ import annotations

from pathlib import Path

from onlinebayes.runs import Row
from recipes.studies.measured_rows import refine

NAME = "multiarm_single"
WANTED = {"dry_friction@arm", "quadratic_drag@arm"}


def judge(data: Path) -> tuple[Row, ...]:
    """Refine the problem and hold it against what is known of the bearing and the air."""
    refined = refine(NAME, data)
    goal = "dry_friction and quadratic_drag"
    return refined.rows(goal, set(refined.accepted) == WANTED, {"qpos.arm": "rad"})
