"""A larger servo whose gain is not known, four runs of 6 s at 50 Hz: 18 s to fit, so that nothing is expected of it."""

from __future__ import annotations

from pathlib import Path

from onlinebayes.runs import Row
from recipes.studies.measured_rows import refine

NAME = "sts3250"
SIGNAL = "qpos.servo"
FRICTION = ("load_dependent_friction@servo", "stribeck_friction@servo", "asymmetric_friction@servo")


def judge(data: Path) -> tuple[Row, ...]:
    """Refine the problem; what is named must be of the gearbox's friction, or nothing is."""
    refined = refine(NAME, data)
    goal = "nothing, or friction of the gearbox"
    return refined.rows(goal, set(refined.accepted) <= set(FRICTION), {SIGNAL: "rad"})
