"""A MuJoCo model's visible geoms as shapes, and where they are in a state."""

from __future__ import annotations

import re

import mujoco
import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.simulators.drawing import Kind, Shape

GROUPS = 3  # as in MuJoCo's own viewer: groups 0, 1, 2
FACES = 400  # of a mesh that is drawn; a robot's visual meshes have tens of thousands, which no small picture shows
FAR = 10.0  # half size of a plane without an end, in extents of the model
# Type of a geom -> kind of the shape, and how many of its sizes count.
KINDS: dict[int, tuple[Kind, int]] = {
    int(mujoco.mjtGeom.mjGEOM_PLANE): ("plane", 2),
    int(mujoco.mjtGeom.mjGEOM_BOX): ("box", 3),
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): ("capsule", 2),
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): ("cylinder", 2),
    int(mujoco.mjtGeom.mjGEOM_SPHERE): ("sphere", 1),
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): ("ellipsoid", 3),
    int(mujoco.mjtGeom.mjGEOM_MESH): ("mesh", 0),
}


def drawn(model: mujoco.MjModel) -> list[int]:
    """Ids of the geoms that are drawn: visible ones, no height fields."""
    return [
        geom
        for geom in range(model.ngeom)
        if model.geom_group[geom] < GROUPS and int(model.geom_type[geom]) in KINDS and _colour(model, geom)[3] > 0
    ]


def shapes(model: mujoco.MjModel) -> tuple[Shape, ...]:
    """One shape a geom, named after it or its body."""
    return tuple(_shape(model, geom) for geom in drawn(model))


def poses(model: mujoco.MjModel, qpos: Float[np.ndarray, "T nq"]) -> Float[Tensor, "T S 7"]:
    """Poses of :func:`shapes`, by the model's kinematics."""
    data, geoms = mujoco.MjData(model), drawn(model)
    result, quaternion = np.empty((len(qpos), len(geoms), 7)), np.empty(4)
    for k, row in enumerate(qpos):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        for i, geom in enumerate(geoms):
            mujoco.mju_mat2Quat(quaternion, data.geom_xmat[geom])
            result[k, i, :3], result[k, i, 3:] = data.geom_xpos[geom], quaternion
    return torch.from_numpy(result)


def _shape(model: mujoco.MjModel, geom: int) -> Shape:
    kind, count = KINDS[int(model.geom_type[geom])]
    size = tuple(float(x) for x in model.geom_size[geom][:count])
    if kind == "plane":
        size = (*(half or FAR * float(model.stat.extent) for half in size), 0.0)
    body = int(model.geom_bodyid[geom])
    vertices, faces = _mesh(model, geom) if kind == "mesh" else (None, None)
    name = model.geom(geom).name or model.body(body).name or "geom"
    return Shape(
        re.sub(r"\W", "_", f"{name}_{geom}"),  # a body may have several geoms without a name
        kind,
        size,
        _colour(model, geom),
        moving=bool(model.body_weldid[body] != 0),
        vertices=vertices,
        faces=faces,
    )


def _colour(model: mujoco.MjModel, geom: int) -> tuple[float, float, float, float]:
    material = int(model.geom_matid[geom])
    rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material] * _mean_texture(model, material)
    red, green, blue, opacity = rgba.tolist()
    return red, green, blue, opacity


def _mean_texture(model: mujoco.MjModel, material: int) -> Float[np.ndarray, " 4"]:
    """Mean colour of a material's texture; white without one."""
    texture, mean = int(model.mat_texid[material][mujoco.mjtTextureRole.mjTEXROLE_RGB]), np.ones(4)
    if texture >= 0:
        first, channels = int(model.tex_adr[texture]), int(model.tex_nchannel[texture])
        pixels = int(model.tex_height[texture]) * int(model.tex_width[texture])
        data = model.tex_data[first : first + pixels * channels].reshape(pixels, channels)
        mean[:3] = data[:, :3].mean(0) / 255
    return mean


def _mesh(model: mujoco.MjModel, geom: int) -> tuple[Float[Tensor, "V 3"], Int[Tensor, "F 3"]]:
    mesh = int(model.geom_dataid[geom])
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    face, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    vertices = np.array(model.mesh_vert[first : first + count], dtype=np.float64)
    thin = _thinned(vertices, np.array(model.mesh_face[face : face + faces], dtype=np.int64))
    return torch.from_numpy(thin[0]), torch.from_numpy(thin[1])


def _thinned(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """A mesh of at most :data:`FACES` faces, or nearly: vertices that share a cell of a grid become one.

    Rossignac and Borrel, Multi-Resolution 3D Approximations for Rendering Complex Scenes (1993).
    """
    cells = 24
    while len(faces) > FACES and cells > 2:
        low, extent = vertices.min(0), max(float(np.ptp(vertices, axis=0).max()), 1e-12)
        place = np.floor((vertices - low) / extent * cells).astype(np.int64)
        _, group = np.unique(place, axis=0, return_inverse=True)
        group = group.ravel()
        number = np.bincount(group)
        means = [np.bincount(group, weights=vertices[:, axis]) / number for axis in range(3)]
        joined = group[faces]
        flat = (joined[:, 0] == joined[:, 1]) | (joined[:, 1] == joined[:, 2]) | (joined[:, 0] == joined[:, 2])
        vertices, faces, cells = np.stack(means, axis=-1), joined[~flat], cells * 3 // 4
    return vertices, faces
