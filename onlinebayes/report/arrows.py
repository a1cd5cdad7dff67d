"""The forces of added effects as arrows at their joints, in the recording's geometry.

A force on a slide is drawn along the joint's axis at the moving body. A torque on a hinge is drawn as the force that
would turn the body that way: at the body's centre of mass, across the arm. The longest arrow of a run is half as long
as what is drawn is wide, so that all arrows of a run compare with each other; names and sizes stand beside them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from onlinebayes.identification import EffectForce, quantities
from onlinebayes.report import geometry, phrases
from onlinebayes.report.colours import EFFECTS

if TYPE_CHECKING:
    from rerun import RecordingStream

Array = NDArray[np.float64]
LENGTH = 0.5  # of the width of what is drawn
LIFT = 0.1  # of the same, by which arrows at one joint stand above each other


def send_arrows(
    stream: RecordingStream,
    root: str,
    model: mujoco.MjModel,
    time: Array,
    qpos: Array,
    forces: tuple[EffectForce, ...],
    keep: NDArray[np.intp],
) -> None:
    """Send one arrow an effect.

    Args:
        stream: the recording.
        root: entity path; the arrows stand below ``root/EFFECT``.
        model: the compiled model.
        time: (T,) of the rows kept [s].
        qpos: (T, nq) where the arrows stand.
        forces: of the effects, at every row of the run.
        keep: which of those rows are kept.
    """
    import rerun as rr

    values = [np.nan_to_num(force.value.cpu().numpy()[keep]) for force in forces]
    largest = max((float(np.abs(value).max()) for value in values if len(value)), default=0.0)
    if not largest:
        return
    low, high = geometry.bounds(model, qpos[:: max(1, len(qpos) // 50)])
    size, above = float((high - low).max()), dict.fromkeys((force.joint for force in forces), 0)
    for k, (force, value) in enumerate(zip(forces, values, strict=True)):
        joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, force.joint)
        if joint < 0:
            continue
        above[force.joint] += 1
        points, ways = places(model, joint, qpos)
        points = points + np.array([0.0, 0.0, LIFT * size * above[force.joint]])
        name = phrases.plain(force.effect).partition(" at ")[0]
        unit = "N" if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE else "N m"
        labels = [f"{name} {quantities.text(float(v), unit)}" for v in value]
        path = geometry.entity(root, force.effect)
        colour = EFFECTS[k % len(EFFECTS)]
        stream.log(path, rr.Arrows3D.from_fields(colors=[colour], radii=[0.008 * size], show_labels=True), static=True)
        stream.send_columns(
            path,
            [rr.TimeColumn("time", duration=time)],
            rr.Arrows3D.columns(
                vectors=ways * (LENGTH * size * value / largest)[:, None], origins=points, labels=labels
            ),
        )


def places(model: mujoco.MjModel, joint: int, qpos: Array) -> tuple[Array, Array]:
    """Return the points and directions of the arrow of a positive force: both (T, 3), in the world [m, 1]."""
    data, body = mujoco.MjData(model), int(model.jnt_bodyid[joint])
    points, ways = np.empty((len(qpos), 3)), np.empty((len(qpos), 3))
    for k, row in enumerate(qpos):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        points[k], ways[k] = data.xipos[body], data.xaxis[joint]
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
            ways[k] = _across(data.xaxis[joint], data.xipos[body] - data.xanchor[joint])
    return points, ways


def _across(axis: Array, arm: Array) -> Array:
    """Unit direction in which a turn about ``axis`` moves the end of ``arm``; any across it where the arm is none."""
    way = np.cross(axis, arm)
    if np.linalg.norm(way) < 1e-9:
        way = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    return way / np.linalg.norm(way)
