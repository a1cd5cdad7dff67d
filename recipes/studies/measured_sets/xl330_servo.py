"""The servo of ``xl330`` with its own control law in the model: goal and position alone, kp in firmware units."""

from __future__ import annotations

from pathlib import Path

from onlinebayes.runs import Row
from recipes.studies.measured_rows import refine, rows_by_gain

GOALS = dict.fromkeys(("kp100", "kp200", "kp400", "kp800"), 0.075)
"""Held-out error over 1 s [rad]."""


def judge(data: Path) -> tuple[Row, ...]:
    """Refine the problem; the held-out error gain by gain."""
    return rows_by_gain(refine("xl330_servo", data), "load_dependent_friction@servo", "qpos.servo", GOALS)
