"""The servo of ``xl330`` with its own control law in the model: goal and position alone, kp in firmware units."""

from __future__ import annotations

from pathlib import Path

from onlinebayes.runs import Row
from recipes.studies.measured_rows import refine

NAME = "xl330_servo"
WANTED = "load_dependent_friction@servo"
SIGNAL = "qpos.servo"
GOAL = 0.075  # [rad], at each gain


def judge(data: Path) -> tuple[Row, ...]:
    """Refine the problem; the held-out error gain by gain, one run of each."""
    refined = refine(NAME, data)
    rows = list(refined.rows(f"{WANTED} among them", WANTED in refined.accepted, {SIGNAL: "rad"}))
    for run, (before, after) in refined.by_run(SIGNAL).items():
        gain = run.partition("-")[0]
        rows.append(Row(f"{NAME}: held-out error at {gain}, before", 1e3 * before, unit="mrad"))
        name = f"{NAME}: held-out error at {gain}, after"
        rows.append(Row(name, 1e3 * after, unit="mrad", goal=f"<= {1e3 * GOAL:g}", holds=after <= GOAL))
    return tuple(rows)
