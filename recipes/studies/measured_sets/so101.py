"""A hobby arm of six position servos: dry friction at every joint, and errors beside those of ``mujoco.sysid``."""

from __future__ import annotations

from pathlib import Path
from statistics import fmean

from onlinebayes.runs import Row
from recipes.studies.measured_rows import refine

NAME = "so101"
PEER = {"shoulder_pan": 3.48, "shoulder_lift": 4.87, "elbow_flex": 7.93, "wrist_flex": 3.80, "wrist_roll": 4.47}
"""Held-out error of ``mujoco.sysid`` with 21 parameters over 1 s [mrad]: friction loss and stiffness of each joint."""

FRICTIONS = ("dry_friction", "load_dependent_friction", "stribeck_friction")
WRONG = ("backlash", "actuator_delay", "sensor_delay", "actuator_gain", "sensor_scale")
LONGEST = 300.0


def judge(data: Path) -> tuple[Row, ...]:
    """Refine the problem that comes with the log; each joint's held-out error beside the peer's."""
    refined = refine(NAME, data, problem=data / "sage_so101" / "problem.toml")
    rubbing = {joint for joint in PEER if any(f"{law}@{joint}" in refined.accepted for law in FRICTIONS)}
    false = [key for key in refined.accepted if key.partition("@")[0] in WRONG]
    goal = "a friction at each of five joints, no play, delay, gain or scale"
    signals = {f"qpos.{joint}": "rad" for joint in PEER}
    rows = list(refined.rows(goal, len(rubbing) == len(PEER) and not false, signals, LONGEST))
    ratios = []
    for joint, peer in PEER.items():
        after = 1e3 * refined.error("after", f"qpos.{joint}")
        ratios.append(after / peer)
        name = f"{NAME}: held-out error at {joint} over that of mujoco.sysid"
        rows.append(Row(name, after / peer, unit="times", goal="<= 1", holds=after <= peer))
    name = f"{NAME}: the same on average"
    rows.append(Row(name, fmean(ratios), unit="times", goal="<= 0.9", holds=fmean(ratios) <= 0.9))
    return tuple(rows)
