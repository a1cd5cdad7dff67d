"""A larger servo whose gain is not known, four runs of 6 s at 50 Hz: its controller limits the rate of its goal.

The effect is one of our own, which the problem file registers; the vocabulary alone has no name for what is missing.
"""

from __future__ import annotations

from pathlib import Path

from onlinebayes.runs import Row
from recipes.studies.measured_rows import refine

NAME = "sts3250"
SIGNAL = "qpos.servo"
RATE = "actuator_rate_limit@goal"
GEARBOX = ("dry_friction", "load_dependent_friction", "stribeck_friction", "asymmetric_friction")


def judge(data: Path) -> tuple[Row, ...]:
    """Refine the problem; what is named after the rate limit must be of the gearbox's friction."""
    refined = refine(NAME, data)
    later = {effect.partition("@")[0] for effect in refined.accepted[1:]}
    holds = refined.accepted[:1] == (RATE,) and later <= set(GEARBOX)
    return refined.rows(f"{RATE} first, then friction of the gearbox or nothing", holds, {SIGNAL: "rad"})
