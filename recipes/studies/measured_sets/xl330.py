"""A servo at four gains, by the volts at its motor: friction that grows with the load, at every gain."""

from __future__ import annotations

from pathlib import Path

from onlinebayes.runs import Row
from recipes.studies.measured_rows import refine

NAME = "xl330"
WANTED = "load_dependent_friction@servo"
SIGNAL = "qpos.servo"
GOALS = {"kp100": 0.085, "kp200": 0.095, "kp400": 0.110, "kp800": 0.095}  # [rad]


def judge(data: Path) -> tuple[Row, ...]:
    """Refine the problem; the held-out error gain by gain, one run of each."""
    refined = refine(NAME, data)
    rows = list(refined.rows(f"{WANTED} among them", WANTED in refined.accepted, {SIGNAL: "rad"}))
    for run, (before, after) in refined.by_run(SIGNAL).items():
        gain = run.partition("-")[0]
        rows.append(Row(f"{NAME}: held-out error at {gain}, before", 1e3 * before, unit="mrad"))
        name = f"{NAME}: held-out error at {gain}, after"
        most = GOALS[gain]
        rows.append(Row(name, 1e3 * after, unit="mrad", goal=f"<= {1e3 * most:g}", holds=after <= most))
    return tuple(rows)
