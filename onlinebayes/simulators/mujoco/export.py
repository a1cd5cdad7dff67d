"""One world as a model of its own: a spec that holds every parameter and native effect, for plain MuJoCo to load.

Only what differs from the file is written. Compiled values are translated back to MJCF's attributes: angles to the
file's unit, a changed body to an explicit inertial, an ``actuator_delay`` to MuJoCo's own ``delay`` with its buffer.
Moments that no body has become the nearest that one could have (see :mod:`.possible_moments`); what the compiler would
derive anew stands as it was derived (see :mod:`.compile_time`).
"""

from __future__ import annotations

import ctypes
import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import mujoco
import numpy as np

from onlinebayes.simulators.mujoco import possible_moments
from onlinebayes.simulators.mujoco.addresses import HINGE, SLIDE, model_array
from onlinebayes.simulators.mujoco.assets import put_beside
from onlinebayes.simulators.mujoco.compile_time import written_out
from onlinebayes.simulators.mujoco.fields import SPEC, SpecAttribute
from onlinebayes.simulators.mujoco.foreign import delay_of, not_exportable, samples
from onlinebayes.simulators.mujoco.inertials import own_inertial
from onlinebayes.simulators.mujoco.model import compile_spec
from onlinebayes.simulators.mujoco.system import MujocoSystem

LISTS = {kind: f"{kind}s" for kind in ("joint", "geom", "pair", "actuator", "tendon", "sensor", "site")} | {
    "body": "bodies"
}
GEOMETRY = {"qpos_spring", "body_pos", "site_pos"}
"""The arrays from which a tendon's length at rest follows."""


def export(system: MujocoSystem, theta: np.ndarray) -> mujoco.MjSpec:
    """The spec of the world with parameters theta (1, P), without the effects that :func:`not_exportable` names."""
    spec = system.spec.copy()
    written_out(spec, compile_spec(spec))
    left_out = not_exportable(system, theta)
    if GEOMETRY & set(system.fields):
        _keep_rest_lengths(spec, system.model)
    for array, values in system.write(theta).items():
        base = model_array(system.model, array)
        if array == possible_moments.FIELD:
            changed = (values[0] != base).any(1)
            values[0, changed] = possible_moments.rigid(values[0, changed])
        if array in SPEC and not np.array_equal(values[0], base):
            _write(spec, system.model, array, values[0], base)
    for effect in system.stages:
        if effect.key not in left_out:
            _write_delay(spec, effect.target, delay_of(system, effect, theta), system.model.opt.timestep)
    compile_spec(spec)
    return spec


def bodies_with_adjusted_inertia(system: MujocoSystem, theta: np.ndarray) -> tuple[str, ...]:
    """Names of the bodies whose fitted moments no body has: the export holds the nearest ones."""
    fields = system.write(theta)
    if possible_moments.FIELD not in fields:
        return ()
    return possible_moments.not_rigid(system.model, fields[possible_moments.FIELD][0], system.model.body_inertia)


def in_folder(spec: mujoco.MjSpec, target: Path, assets: str) -> tuple[str, dict[str, bytes]]:
    """The text of a spec for a folder: meshes and textures stay where they are and are found from there.

    Args:
        spec: changed: its paths start from the folder.
        target: the folder that the text will lie in.
        assets: folder within it for files that the spec has in memory.

    Returns:
        The text, and the files it needs that lie nowhere yet, by their paths from the folder.
    """
    files = [*spec.meshes, *spec.textures, *spec.hfields, *spec.skins]
    if spec.modelfiledir and any(asset.file for asset in files):
        for name in ("meshdir", "texturedir"):
            folder = Path(spec.modelfiledir) / getattr(spec.compiler, name)
            setattr(spec.compiler, name, Path(os.path.relpath(folder.resolve(), target.resolve())).as_posix())
        spec.modelfiledir = str(target)
    beside = put_beside(spec, target, assets)
    return to_xml(spec), beside


def to_xml(spec: mujoco.MjSpec) -> str:
    """MJCF text with all 17 digits, so that the file replays as the spec does (MuJoCo writes 6)."""
    with _precision(17):
        return spec.to_xml()


def _write(spec: mujoco.MjSpec, model: mujoco.MjModel, array: str, values: np.ndarray, base: np.ndarray) -> None:
    place = SPEC[array]
    if place.kind == "option":
        current = getattr(spec.option, place.attribute)
        setattr(spec.option, place.attribute, values.copy() if np.ndim(current) else float(values[0]))
        return
    for element in getattr(spec, LISTS[place.kind]):  # those without a name too: contacts of a body's geoms
        rows = _rows(model, array, place, element.id)
        if rows is None or np.array_equal(values[rows], base[rows]):
            continue
        if place.kind == "body" and place.attribute in ("mass", "inertia", "ipos", "iquat"):
            own_inertial(spec, element, model)
        _assign(element, place, _in_file_units(spec, model, place, element.id, np.atleast_1d(values[rows])))


def _rows(model: mujoco.MjModel, array: str, place: SpecAttribute, number: int) -> int | slice | None:
    """Row of the array that holds the element; several dofs of a joint share one value, the first one's."""
    element = getattr(model, place.kind)(number)
    if array.startswith("dof_"):
        return int(element.dofadr[0])
    if array == "qpos_spring":
        return int(element.qposadr[0]) if model.jnt_type[element.id] in (SLIDE, HINGE) else None
    return int(element.id)


def _assign(element: object, place: SpecAttribute, value: np.ndarray) -> None:
    current = getattr(element, place.attribute)
    if np.ndim(current) == 0:
        setattr(element, place.attribute, type(current)(value[0]))
        return
    whole, offset, value = np.array(current, dtype=float), max(place.offset, 0), value[max(-place.offset, 0) :]
    whole[offset : offset + len(value)] = value[: len(whole) - offset]
    setattr(element, place.attribute, whole)


def _in_file_units(
    spec: mujoco.MjSpec, model: mujoco.MjModel, place: SpecAttribute, number: int, value: np.ndarray
) -> np.ndarray:
    angle = place.kind == "joint" and place.attribute in ("springref", "range")
    if angle and spec.compiler.degree and model.joint(number).type[0] == HINGE:
        return np.rad2deg(value)
    return value


def _keep_rest_lengths(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """A tendon that took its rest length from the joints' springref keeps it when that, or its path, moves."""
    for tendon in spec.tendons:
        if tendon.springlength[0] == tendon.springlength[1] == -1:
            tendon.springlength = model.tendon_lengthspring[tendon.id].copy()


def _write_delay(spec: mujoco.MjSpec, target: str, delay: float, timestep: float) -> None:
    if delay > 0:
        actuator = spec.actuator(target)
        actuator.delay, actuator.interp = delay, 1
        actuator.nsample = samples(delay, timestep)


@contextmanager
def _precision(digits: int) -> Iterator[None]:
    # MuJoCo has this setting but no public function for it.
    folder = Path(mujoco.__file__).parent
    library = ctypes.CDLL(str(next(itertools.chain(folder.glob("libmujoco*"), folder.glob("mujoco.dll")))))
    before = library._mjPRIVATE__get_xml_precision()
    library._mjPRIVATE__set_xml_precision(digits)
    try:
        yield
    finally:
        library._mjPRIVATE__set_xml_precision(before)
