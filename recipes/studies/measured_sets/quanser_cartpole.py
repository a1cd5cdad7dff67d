"""A cart with a hanging pole: a push on the cart, and friction of the pole."""

from __future__ import annotations

from pathlib import Path

from onlinebayes.criticism import same_as
from onlinebayes.runs import Row
from recipes.studies.measured_rows import refine

NAME = "quanser_cartpole"
FRICTION = ("viscous_friction@pole", "dry_friction@pole", "quadratic_drag@pole", "load_dependent_friction@pole")
MOST = {"qpos.cart": 0.5, "qpos.pole": 0.6}
"""Of the held-out error before, that may be left."""


def judge(data: Path) -> tuple[Row, ...]:
    """Refine the problem; both must be among what is accepted, and both errors fall by what they give."""
    refined = refine(NAME, data)
    accepted = {same_as(key) for key in refined.accepted}
    named = "constant_load@cart" in accepted and bool(accepted & set(FRICTION))
    rows = list(
        refined.rows("constant_load@cart and friction of the pole", named, {"qpos.cart": "m", "qpos.pole": "rad"})
    )
    for signal, most in MOST.items():
        left = refined.error("after", signal) / refined.error("before", signal)
        rows.append(Row(f"{NAME}: {signal}, after over before", left, goal=f"<= {most:g}", holds=left <= most))
    return tuple(rows)
