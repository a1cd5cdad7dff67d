"""A MuJoCo model's visible geoms as shapes, and where they are in a state."""

from __future__ import annotations

from typing import Literal

import mujoco
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.simulators.drawing import Shape

GROUPS = 3  # as in MuJoCo's own viewer: groups 0, 1, 2
KINDS: dict[int, tuple[Literal["box", "capsule", "cylinder", "sphere", "ellipsoid", "mesh"], int]] = {
    int(mujoco.mjtGeom.mjGEOM_BOX): ("box", 3),
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): ("capsule", 2),
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): ("cylinder", 2),
    int(mujoco.mjtGeom.mjGEOM_SPHERE): ("sphere", 1),
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): ("ellipsoid", 3),
    int(mujoco.mjtGeom.mjGEOM_MESH): ("mesh", 0),
}


def drawn(model: mujoco.MjModel) -> list[int]:
    """Ids of the geoms that are drawn: visible ones, no planes or height fields."""
    return [g for g in range(model.ngeom) if model.geom_group[g] < GROUPS and int(model.geom_type[g]) in KINDS]


def shapes(model: mujoco.MjModel) -> tuple[Shape, ...]:
    """One shape a geom."""
    found = []
    for geom in drawn(model):
        kind, sizes = KINDS[int(model.geom_type[geom])]
        material = int(model.geom_matid[geom])
        colour = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
        vertices, faces = _mesh(model, geom) if kind == "mesh" else (None, None)
        found.append(
            Shape(
                f"geom{geom}",
                kind,
                tuple(float(x) for x in model.geom_size[geom][:sizes]),
                (float(colour[0]), float(colour[1]), float(colour[2]), float(colour[3])),
                bool(model.body_weldid[model.geom_bodyid[geom]] != 0),
                vertices,
                faces,
            )
        )
    return tuple(found)


def poses(model: mujoco.MjModel, qpos: Float[np.ndarray, "T nq"]) -> Float[Tensor, "T S 7"]:
    """Poses of :func:`shapes`, by the model's kinematics."""
    data, geoms = mujoco.MjData(model), drawn(model)
    result, quaternion = np.empty((len(qpos), len(geoms), 7)), np.empty(4)
    for k, row in enumerate(qpos):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        for i, geom in enumerate(geoms):
            mujoco.mju_mat2Quat(quaternion, data.geom_xmat[geom])
            result[k, i] = [*data.geom_xpos[geom], *quaternion]
    return torch.from_numpy(result)


def _mesh(model: mujoco.MjModel, geom: int) -> tuple[Tensor, Tensor]:
    mesh = int(model.geom_dataid[geom])
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    face, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    vertices = torch.from_numpy(np.array(model.mesh_vert[first : first + count], dtype=np.float64))
    return vertices, torch.from_numpy(np.array(model.mesh_face[face : face + faces], dtype=np.int64))
