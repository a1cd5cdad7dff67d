"""Eleven balls dropped from a bridge: the air is named, and not credited to balls that it hardly slows.

Which law the drag has (linear or quadratic in the speed) these films do not tell; a weaker gravity, which explains a
single ball as well, must be refused because the balls do not agree on it.
"""

from __future__ import annotations

from pathlib import Path

from onlinebayes.runs import Row
from recipes.studies.measured_rows import Refined, refine

NAME = "ball_drops"
DRAG = ("viscous_friction@height", "quadratic_drag@height")
WHIFFLE = ("whiffle_ball_1", "whiffle_ball_2", "yellow_whiffle_ball", "orange_whiffle_ball")
SLOWED = (*WHIFFLE, "tennis_ball", "blue_basketball")
INNOCENT = ("bowling_ball", "golf_ball", "baseball")


def judge(data: Path) -> tuple[Row, ...]:
    """Refine the problem and hold it against what is known of balls."""
    refined = refine(NAME, data)
    drag = len(refined.accepted) == 1 and refined.accepted[0] in DRAG
    rows = refined.rows("drag (viscous or quadratic) and nothing else", drag, {"qpos.height": "m"})
    return (
        *rows,
        *(_credited(refined, ball, True) for ball in SLOWED),
        *(_credited(refined, ball, False) for ball in INNOCENT),
    )


def _credited(refined: Refined, ball: str, wanted: bool) -> Row:
    """Judge whether the 90 % interval of a ball's drag lies above zero."""
    lows = [value["q05"] for name, value in refined.report["parameters"].items() if f"[run {ball}-*]" in name]
    credited = bool(lows) and min(lows) > 0
    goal = "drag" if wanted else "none"
    return Row(f"{NAME}: credited to {ball}", "drag" if credited else "none", goal=goal, holds=credited == wanted)
