"""A servo at four gains, by the volts at its motor: friction that grows with the load, at every gain."""

from __future__ import annotations

from pathlib import Path

from onlinebayes.runs import Row
from recipes.studies.measured_rows import refine, rows_by_gain

GOALS = {"kp100": 0.085, "kp200": 0.095, "kp400": 0.110, "kp800": 0.095}
"""Held-out error over 1 s that load-dependent friction reached in a scalar replay [rad]."""


def judge(data: Path) -> tuple[Row, ...]:
    """Refine the problem; the held-out error gain by gain."""
    return rows_by_gain(refine("xl330", data), "load_dependent_friction@servo", "qpos.servo", GOALS)
