"""A MuJoCo model in a Rerun recording: its visible geoms as shapes, its bodies moving along the run.

Shapes are logged once and belong to their body's entity; the body's pose is sent as one column per run. The measured
motion is drawn solid, simulated ones as wireframes, so that two almost equal poses stay readable.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
import torch
from numpy.typing import NDArray

from onlinebayes.identification import AXES, rotations

if TYPE_CHECKING:
    from rerun import RecordingStream

Array = NDArray[np.float64]
Colour = tuple[int, int, int, int]
# Kind of a joint with an orientation -> where its quaternion begins among its positions.
QUATERNION = {int(mujoco.mjtJoint.mjJNT_FREE): 3, int(mujoco.mjtJoint.mjJNT_BALL): 0}
_VISIBLE_GROUPS = 3  # as in MuJoCo's own viewer: groups 0, 1, 2


def log_shapes(stream: RecordingStream, root: str, model: mujoco.MjModel, ghost: Colour | None = None) -> None:
    """Log the model's geoms below ``root``, one entity a body.

    Args:
        stream: the recording.
        root: entity path.
        model: the compiled model.
        ghost: draw wireframes in this colour instead of solids in the model's own colours.
    """
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        if model.geom_group[geom] >= _VISIBLE_GROUPS or (ghost is not None and model.body_weldid[body] == 0):
            continue
        shape = _shape(model, geom, ghost)
        if shape is not None:
            stream.log(entity(root, _body(model, body), f"geom{geom}"), shape, static=True)


def send_motion(stream: RecordingStream, root: str, model: mujoco.MjModel, time: Array, qpos: Array) -> None:
    """Send the pose of every body that can move.

    Args:
        stream: the recording.
        root: entity path, as in :func:`log_shapes`.
        model: the compiled model.
        time: (T,) on the time line ``time`` [s].
        qpos: (T, nq) [m, rad].
    """
    import rerun as rr

    if len(time) == 0:  # a run too short for a single window
        return
    positions, quaternions = poses(model, qpos)
    for body in range(model.nbody):
        path = entity(root, _body(model, body))
        if model.body_weldid[body] == 0:
            pose = rr.Transform3D(translation=positions[0, body], quaternion=quaternions[0, body])
            stream.log(path, pose, static=True)
        else:
            stream.send_columns(
                path,
                [rr.TimeColumn("time", duration=time)],
                rr.Transform3D.columns(translation=positions[:, body], quaternion=quaternions[:, body]),
            )


def entity(root: str, *parts: str) -> str:
    """The entity path of ``parts`` below ``root``; parts may hold any character."""
    import rerun as rr

    return "/".join([root, *(rr.escape_entity_path_part(part) for part in parts)])


def poses(model: mujoco.MjModel, qpos: Array) -> tuple[Array, Array]:
    """Positions (T, nbody, 3) [m] and orientations (T, nbody, 4), xyzw, of all bodies in the world."""
    data = mujoco.MjData(model)
    positions, quaternions = np.empty((len(qpos), model.nbody, 3)), np.empty((len(qpos), model.nbody, 4))
    for k, row in enumerate(qpos):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        positions[k], quaternions[k] = data.xpos, data.xquat
    return positions, quaternions[..., [1, 2, 3, 0]]


def bounds(model: mujoco.MjModel, qpos: Array) -> tuple[Array, Array]:
    """Lower and upper corner (3,) [m] of the box that holds all drawn geoms in all of the positions qpos (T, nq)."""
    drawn = [
        g for g in range(model.ngeom)
        if model.geom_group[g] < _VISIBLE_GROUPS and model.geom_type[g] != mujoco.mjtGeom.mjGEOM_PLANE
    ]  # fmt: skip
    if not drawn or not len(qpos):
        return np.asarray(model.stat.center) - model.stat.extent / 2, np.asarray(
            model.stat.center
        ) + model.stat.extent / 2
    low, high, data = np.full(3, np.inf), np.full(3, -np.inf), mujoco.MjData(model)
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        turned = data.geom_xmat[drawn].reshape(-1, 3, 3)
        centre = data.geom_xpos[drawn] + np.einsum("gij,gj->gi", turned, model.geom_aabb[drawn, :3])
        reach = np.einsum("gij,gj->gi", np.abs(turned), model.geom_aabb[drawn, 3:])
        low, high = np.minimum(low, (centre - reach).min(0)), np.maximum(high, (centre + reach).max(0))
    return low, high


def measured_qpos(model: mujoco.MjModel, signals: tuple[str, ...], measured: Array, simulated: Array) -> Array:
    """(T, nq): the measured positions where there are any, the simulated ones elsewhere.

    Args:
        model: the compiled model.
        signals: names of the columns of ``measured``.
        measured: (T, S), nan where not measured.
        simulated: (T, nq).
    """
    qpos = simulated.copy()
    for column, signal in enumerate(signals):
        kind, _, name = signal.partition(".")
        if kind != "qpos":
            continue
        joint, part = _joint(model, name)
        known = np.isfinite(measured[:, column])
        if joint >= 0 and known.any():
            rows = np.arange(len(qpos))
            qpos[:, model.jnt_qposadr[joint] + part] = np.interp(rows, rows[known], measured[known, column])
    return qpos


def measured_turns(model: mujoco.MjModel, signals: tuple[str, ...], away: Array, qpos: Array) -> Array:
    """(T, nq): the orientations of free and ball joints turned to where they were measured.

    Args:
        model: the compiled model.
        signals: names of the columns of ``away``.
        away: (T, S), measured less simulated; nan where not measured.
        qpos: (T, nq), with simulated quaternions.
    """
    qpos, rows = qpos.copy(), np.arange(len(qpos))
    for joint in range(model.njnt):
        names = [f"qpos.{model.joint(joint).name}.{axis}" for axis in AXES]
        kind = int(model.jnt_type[joint])
        if kind not in QUATERNION or not set(names) <= set(signals):
            continue
        turn = away[:, [signals.index(name) for name in names]]
        known = np.isfinite(turn).all(1)
        if known.any():
            first = model.jnt_qposadr[joint] + QUATERNION[kind]
            turn = np.stack([np.interp(rows, rows[known], part[known]) for part in turn.T], -1)
            turned = rotations.product(
                torch.from_numpy(qpos[:, first : first + 4]), rotations.exponential(torch.from_numpy(turn))
            )
            qpos[:, first : first + 4] = turned.numpy()
    return qpos


def _joint(model: mujoco.MjModel, name: str) -> tuple[int, int]:
    """Id of the joint and the index within its positions; -1 for an unknown one."""
    joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
    stem, _, part = name.rpartition(".")
    if joint < 0 and part.isdigit():
        return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, stem), int(part)
    return joint, 0


def _body(model: mujoco.MjModel, body: int) -> str:
    return mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body) or f"body{body}"


def _shape(model: mujoco.MjModel, geom: int, ghost: Colour | None) -> Any:
    """The Rerun archetype of a geom in its body's frame, None for kinds that are not drawn.

    Those are height fields, signed distances, and planes: the viewer has a ground of its own.
    """
    import rerun as rr

    size, centre = model.geom_size[geom], model.geom_pos[geom]
    quaternion = model.geom_quat[geom][[1, 2, 3, 0]]
    colour = np.uint8(255 * _rgba(model, geom)) if ghost is None else ghost
    fill = rr.components.FillMode.Solid if ghost is None else rr.components.FillMode.MajorWireframe
    style: dict[str, Any] = {"colors": [colour], "fill_mode": fill, "quaternions": [quaternion]}
    at: dict[str, Any] = {"centers": [centre]}
    match mujoco.mjtGeom(model.geom_type[geom]):
        case mujoco.mjtGeom.mjGEOM_BOX:
            return rr.Boxes3D(half_sizes=[size], **at, **style)
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return rr.Ellipsoids3D(half_sizes=[[size[0]] * 3], **at, **style)
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            return rr.Ellipsoids3D(half_sizes=[size], **at, **style)
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return rr.Cylinders3D(lengths=[2 * size[1]], radii=[size[0]], **at, **style)
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            # Rerun's capsule starts at its origin, MuJoCo's is centred.
            start = centre - _rotated(model.geom_quat[geom], np.array([0.0, 0.0, size[1]]))
            return rr.Capsules3D(lengths=[2 * size[1]], radii=[size[0]], translations=[start], **style)
        case mujoco.mjtGeom.mjGEOM_MESH:
            return _mesh(model, geom, colour if ghost is None else (*ghost[:3], 90))
    return None


def _mesh(model: mujoco.MjModel, geom: int, colour: Any) -> Any:
    import rerun as rr

    mesh = int(model.geom_dataid[geom])
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    face, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    own = np.asarray(model.mesh_vert[first : first + count], dtype=np.float64)
    vertices = _rotated(model.geom_quat[geom], own) + model.geom_pos[geom]
    return rr.Mesh3D(
        vertex_positions=vertices, triangle_indices=model.mesh_face[face : face + faces], albedo_factor=colour
    )


def _rotated(quaternion: Array, vectors: Array) -> Array:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return vectors @ matrix.reshape(3, 3).T


def _rgba(model: mujoco.MjModel, geom: int) -> Array:
    material = int(model.geom_matid[geom])
    return np.asarray(model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom], dtype=np.float64)
