"""Ends of a machine that the log knows nothing of, as a gripper beside an arm: they are held where the model has them.

A body is such where no column shows it or anything that it carries, none is the command of what moves it though others
are commanded, and none is left that could be. Where nothing is commanded a machine may swing freely: nothing is held.
What is passive and hangs beside such a body (the fingers of a linkage) goes with it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import mujoco

from onlinebayes.problems.welding import needing_joints, weld
from onlinebayes.runs import BadInput


def idle_bodies(spec: mujoco.MjSpec, missing: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """The bodies to weld, in the model's order.

    Args:
        spec: of the model.
        missing: the model's names without a column, each with the columns that it could be.
    """
    unknown = {name for name, columns in missing.items() if not columns}
    acting = [(element.name, needed) for kind, element, needed in needing_joints(spec) if kind == "actuator"]
    commanded = {joint for name, needed in acting if f"ctrl.{name}" not in unknown for joint in needed}
    if not commanded:
        return ()
    still = {joint.name for joint in spec.joints if f"qpos.{joint.name}" in unknown} - commanded
    driven = {joint for name, needed in acting if needed <= still for joint in needed}
    ends = [body for body in spec.bodies if _joints(body) and _joints(body) <= still and _carried(body) <= still]
    moved = [body for body in ends if _joints(body) & driven]
    beside = {body.parent.name for body in moved}
    found = [body for body in ends if body in moved or _hangs_on(body, beside)]
    names = tuple(body.name for body in found)
    return names if all(names) and _may_be_welded(spec, names) else ()


def held(bodies: Sequence[str]) -> str:
    """The line that says why they are welded."""
    return f"{', '.join(bodies)}: no column shows how they move or moves them; they stay where the model has them"


def _joints(body: Any) -> set[str]:
    return {joint.name for joint in body.joints}


def _carried(body: Any) -> set[str]:
    """The joints of all bodies that a body carries."""
    return {joint for child in body.bodies for joint in _joints(child) | _carried(child)}


def _hangs_on(body: Any, names: Collection[str]) -> bool:
    """Check whether a body is carried by one of some bodies."""
    while (parent := body.parent) is not None and parent.name != "world":
        if parent.name in names:
            return True
        body = parent
    return False


def _may_be_welded(spec: mujoco.MjSpec, names: Sequence[str]) -> bool:
    try:
        weld(spec.copy(), names)
    except BadInput:
        return False
    return True
