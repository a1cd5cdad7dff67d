"""A measured wrench from outside, as a command of the model: what pushed and turned a body while the log was written.

    xfrc.<body>.0, .1, .2   force [N],  .3, .4, .5  torque [N m],  in the world's axes, at the body's centre of mass

For each a <motor> at a site there, with the world as its reference (MuJoCo's ``xfrc_applied``, which rolls out without
being told row by row). The site stands where the model's file puts the centre of mass.
"""

from __future__ import annotations

from collections.abc import Iterable

import mujoco

from onlinebayes.runs import BadInput, nearest
from onlinebayes.simulators.mujoco.addresses import names
from onlinebayes.simulators.mujoco.model import compile_spec

PREFIX = "xfrc."
AXES = 6


def with_wrenches(spec: mujoco.MjSpec, columns: Iterable[str]) -> mujoco.MjSpec:
    """The spec with an actuator for each column ``xfrc.<body>.<axis>``; those that it has already stay.

    Args:
        spec: of the model; not changed.
        columns: names of the tables' columns, others among them.

    Raises:
        BadInput: no such body, one that is fixed to the world, or no such axis.
    """
    wanted = sorted(name for name in columns if name.startswith(PREFIX))
    if not wanted:
        return spec
    spec = spec.copy()
    model = compile_spec(spec)
    missing = [name for name in wanted if name not in names(model, "actuator")]
    if missing and PREFIX not in names(model, "site"):
        spec.worldbody.add_site(name=PREFIX)
    for column in missing:
        body, axis = _parts(model, column)
        site = f"{PREFIX}{body}"
        if spec.site(site) is None:
            spec.body(body).add_site(name=site, pos=model.body(body).ipos)
        gear = [0.0] * AXES
        gear[axis] = 1.0
        motor = spec.add_actuator(name=column, trntype=mujoco.mjtTrn.mjTRN_SITE, target=site, refsite=PREFIX)
        motor.gear = gear
    return spec


def is_wrench(command: str) -> bool:
    """Check whether a command was added by :func:`with_wrenches` and is no actuator's."""
    return command.startswith(PREFIX)


def _parts(model: mujoco.MjModel, column: str) -> tuple[str, int]:
    body, _, axis = column.removeprefix(PREFIX).rpartition(".")
    if axis not in tuple(map(str, range(AXES))):
        raise BadInput(f"column '{column}' is no part of a wrench", f"write {PREFIX}<body>.0 to .{AXES - 1}")
    moving = [name for i, name in enumerate(names(model, "body")) if name and model.body_weldid[i]]
    if body not in moving:
        cure = f"{nearest(body, moving)}; or add the column to 'ignore' in the problem file"
        raise BadInput(f"column '{column}': the model has no body '{body}' that moves", cure)
    return body, int(axis)
