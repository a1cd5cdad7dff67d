"""A model's columns: the commands that drive it, one by one, and the signals that show its motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco

from onlinebayes.simulators.mujoco.addresses import names


@dataclass(frozen=True)
class Command:
    """One command column: its name, its actuator's id and its place in ``ctrl``."""

    name: str
    actuator: int
    ctrl: int


def commands(model: mujoco.MjModel, visible: Sequence[str]) -> tuple[Command, ...]:
    """The commands of the model's own actuators; actuators that effects added have none."""
    columns = []
    for name in visible:
        i = model.actuator(name).id
        first, count = int(model.actuator_ctrladr[i]), int(model.actuator_ctrlnum[i])
        for k in range(count):
            columns.append(Command(name if count == 1 else f"{name}.{k}", i, first + k))
    return tuple(columns)


def signals(model: mujoco.MjModel) -> tuple[str, ...]:
    """``qpos.<joint>`` of all joints, then ``qvel.<joint>``; with .0 ... where a joint has several."""
    widths = {mujoco.mjtJoint.mjJNT_FREE: (7, 6), mujoco.mjtJoint.mjJNT_BALL: (4, 3)}
    found = []
    for part, key in enumerate(("qpos", "qvel")):
        for i, name in enumerate(names(model, "joint")):
            width = widths.get(mujoco.mjtJoint(model.jnt_type[i]), (1, 1))[part]
            found += [f"{key}.{name}"] if width == 1 else [f"{key}.{name}.{k}" for k in range(width)]
    return tuple(found)
