"""Meshes, textures and height fields that a model has in memory alone, so that its text could be loaded again.

A spec may carry the bytes of its files (``MjSpec.assets``, which ``dm_control.mjcf`` fills): :func:`put_beside` says
which to write where, and lets the spec name them there. A compiled model has the shapes, but not the files:
:func:`take_shapes` writes vertices and heights into the spec itself. Its textures become plain ones, which no physics
depends on. (``MjSpec.assets``, <mesh vertex=...>, <hfield elevation=...>: https://mujoco.readthedocs.io/en/stable.)
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import mujoco
from scipy.spatial.transform import Rotation


def put_beside(spec: mujoco.MjSpec, target: Path, folder: str) -> dict[str, bytes]:
    """Let the spec name its files in memory as ``folder/<name>``, seen from the folder ``target``.

    Args:
        spec: changed: its files' names, and where the folder of meshes or textures was for these files alone, that.
        target: where the model's text will lie.
        folder: for the files, within ``target``.

    Returns:
        Path from ``target`` -> content, to be written.
    """
    # MuJoCo looks a file up by its last part, whatever the case.
    known = {PurePosixPath(key).name.casefold(): content for key, content in reversed(spec.assets.items())}
    places = {"meshdir": [*spec.meshes, *spec.hfields, *spec.skins], "texturedir": [*spec.textures]}
    if known and spec.strippath:  # the last part was all that counted so far
        for asset in itertools.chain(*places.values()):
            _rename(asset, {name: _last(name) for name in _files(asset)})
        spec.strippath = False
    found: dict[str, bytes] = {}
    for place, assets in places.items():
        files = {name for asset in assets for name in _files(asset)}
        mine = {name for name in files if _last(name).casefold() in known}
        if mine and mine == files:
            setattr(spec.compiler, place, "")
        start = target / getattr(spec.compiler, place)
        paths = {name: f"{folder}/{_last(name)}" for name in mine}
        found |= {path: known[_last(name).casefold()] for name, path in paths.items()}
        for asset in assets:
            _rename(asset, {n: Path(os.path.relpath(target / path, start)).as_posix() for n, path in paths.items()})
    return found


def take_shapes(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """Put what a compiled model knows of its meshes, height fields and textures in the place of their files.

    Args:
        spec: read from the text that the model was compiled from; changed.
        model: compiled; its elements in the spec's order.

    Raises:
        ValueError: the spec has others than the model.
    """
    for i, mesh in _with_files(spec.meshes, model.nmesh):
        _take_mesh(mesh, model, i)
    for i, field in _with_files(spec.hfields, model.nhfield):
        first, field.file, field.content_type = int(model.hfield_adr[i]), "", ""
        field.name = model.hfield(i).name
        field.nrow, field.ncol = int(model.hfield_nrow[i]), int(model.hfield_ncol[i])
        field.userdata = model.hfield_data[first : first + field.nrow * field.ncol]
    for i, texture in _with_files(spec.textures, model.ntex):
        texture.name, texture.file, texture.content_type = model.tex(i).name, "", ""
        texture.cubefiles = [""] * len(texture.cubefiles)
        texture.builtin = mujoco.mjtBuiltin.mjBUILTIN_FLAT
        texture.width = texture.height = 1
        texture.gridsize = [1, 1]
    for skin in [skin for skin in spec.skins if skin.file]:
        spec.delete(skin)


def _with_files(assets: Sequence[Any], count: int) -> list[tuple[int, Any]]:
    """Those that come from files, each with its number in the compiled model."""
    found = [(i, asset) for i, asset in enumerate(assets) if any(_files(asset))]
    if found and len(assets) != count:
        raise ValueError(f"{len(assets)} assets in the text, {count} in the model")
    return found


def _take_mesh(mesh: mujoco.MjsMesh, model: mujoco.MjModel, i: int) -> None:
    """The vertices as the file has them, scaled and moved: the compiled ones stand in the mesh's principal axes."""
    first, count = int(model.mesh_vertadr[i]), int(model.mesh_vertnum[i])
    faces = model.mesh_face[int(model.mesh_faceadr[i]) :][: int(model.mesh_facenum[i])]
    turn = Rotation.from_quat(model.mesh_quat[i], scalar_first=True)
    mesh.name, mesh.file, mesh.content_type = model.mesh(i).name, "", ""
    mesh.scale, mesh.refpos, mesh.refquat = [1.0] * 3, [0.0] * 3, [1.0, 0.0, 0.0, 0.0]
    mesh.uservert = (turn.apply(model.mesh_vert[first : first + count]) + model.mesh_pos[i]).ravel()
    mesh.userface = faces.ravel()


def _files(asset: Any) -> Iterator[str]:
    yield from filter(None, [asset.file, *(asset.cubefiles if isinstance(asset, mujoco.MjsTexture) else ())])


def _rename(asset: Any, names: dict[str, str]) -> None:
    asset.file = names.get(asset.file, asset.file)
    if isinstance(asset, mujoco.MjsTexture):
        asset.cubefiles = [names.get(name, name) for name in asset.cubefiles]


def _last(name: str) -> str:
    return PurePosixPath(name.replace("\\", "/")).name
