"""What a log shows that a model is not: a base that stands fast, a machine that is driven by something."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import mujoco

from onlinebayes.problems.drafting.matching import parts
from onlinebayes.problems.drafting.words import GOALS, KINDS, QUANTITIES, said_by, words
from onlinebayes.simulators.mujoco import MujocoSimulator

HEAD = 4096
"""Characters of a model's file that are looked at."""


def unmeasured_bodies(model: mujoco.MjModel, lacking: Collection[str]) -> dict[str, str]:
    """``qpos.base`` -> its body, for every free joint of which no number was measured, whose body has a name.

    Args:
        model: gives joints and bodies.
        lacking: signals without a column.
    """
    found = {}
    for joint in parts([*lacking]):
        i = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint.removeprefix("qpos."))
        if joint.startswith("qpos.") and i >= 0 and model.jnt_type[i] == mujoco.mjtJoint.mjJNT_FREE:
            found[joint] = model.body(int(model.jnt_bodyid[i])).name
    return {joint: body for joint, body in found.items() if body and len(parts([*lacking])[joint]) == 7}


def without_free(lacking: Mapping[str, tuple[str, ...]], free: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    """The names without those of free joints that nobody measured."""
    return {name: columns for name, columns in lacking.items() if name.rpartition(".")[0] not in free}


def weld_of(joint: str, body: str) -> str:
    """The line that says what to do about a free joint that nobody measured."""
    return (
        f"{joint}.0 to .6: no column was found; name them, or where '{body}' does not move, fix it: "
        f'[model_edit] weld = ["{body}"]'
    )


def no_actuator(simulator: MujocoSimulator, model: Path, unused: Sequence[str]) -> str:
    """The line for a model without an actuator beside a log with commands; empty where there is nothing to say.

    Args:
        simulator: the model.
        model: its file.
        unused: columns that nothing takes.
    """
    told = [name for name in unused if _is_command(name)]
    if simulator.model.nu or not told:
        return ""
    joints = [joint for joint, kind in simulator.joint_kinds.items() if kind in ("hinge", "slide")]
    kind, joint = _kind_told(told[0]), _joint_told(told[0], joints)
    name = told[0].removeprefix("ctrl.") if told[0].startswith("ctrl.") else joint or kind.partition(" ")[0]
    tag = f'<{kind} name="{name}" joint="{joint or "..."}"/>'
    urdf = " (a URDF has none: save it as MJCF first)" if "<robot" in model.read_text(errors="replace")[:HEAD] else ""
    more, each = (f" and {len(told) - 1} more", ", one for each,") if len(told) > 1 else ("", "")
    return (
        f"the model has no actuator, the log has the command {told[0]}{more}: "
        f"add <actuator>{tag}</actuator>{each} to the model{urdf}"
    )


def _joint_told(command: str, joints: Sequence[str]) -> str:
    """The only joint, or the one of which a command's name says most; empty where several could be it."""
    if len(joints) == 1:
        return joints[0]
    said = words(command)
    named = [joint for joint in joints if set(words(joint)) <= {*said}]
    most = max((len(words(joint)) for joint in named), default=0)
    best = [joint for joint in named if len(words(joint)) == most]
    return best[0] if len(best) == 1 else ""


def _kind_told(command: str) -> str:
    """The MJCF element of an actuator that takes such a command: a servo where it says a position or a speed."""
    said = said_by(words(command))
    if said.speed:
        return 'velocity kv="..."'
    return 'position kp="..."' if said.position or said.goal else "motor"


def _is_command(name: str) -> bool:
    said = words(name)
    return bool(set(said) & (KINDS["ctrl"] | GOALS | QUANTITIES)) and not said_by(said).foreign
