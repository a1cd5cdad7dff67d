"""A larger servo whose gain is not known, four runs of 6 s at 50 Hz: 18 s to fit, of which one goal in two is too fast.

Its controller limits the rate of its goal, which two seconds of one run show: too few to be significant, so that
nothing is named. Added by hand it must lower the error of the run that is held out.
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
    """Refine the problem as it is, and with the rate limit; what else is named must be of the gearbox's friction."""
    rows = []
    found = [refine(NAME, data, add) for add in ((), (RATE,))]
    for refined in found:
        named = {effect.partition("@")[0] for effect in refined.accepted if effect != RATE}
        rows += refined.rows("friction of the gearbox, or nothing", named <= set(GEARBOX), {SIGNAL: "rad"})
    plain, limited = (refined.error("before", SIGNAL) for refined in found)
    name = f"{NAME}: fall of the held-out error by {RATE} alone"
    return (*rows, Row(name, plain / limited, unit="times", goal="above 1", holds=limited < plain))
