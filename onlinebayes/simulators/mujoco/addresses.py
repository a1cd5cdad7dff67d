"""Addresses of physical parameters in a compiled model: ``<kind>.<name>.<field>[index]`` or ``option.<field>``.

An address resolves to the cells of ``mjModel`` arrays that a value is written to, each with a sign:
``actuator.goal.kp`` is ``gainprm[0] = kp`` and ``biasprm[1] = -kp`` together. A name with ``*`` or ``?`` is one value
for all elements that it matches in the user's model; elements that are added to the model later are not among them. The
fields' names are those of :mod:`.fields`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import mujoco
import numpy as np

from onlinebayes.runs import BadInput, nearest, similar
from onlinebayes.simulators.mujoco import pseudo_inertia
from onlinebayes.simulators.mujoco.fields import FIELDS, LIMITED, PLAIN, UNITS, Column

_OBJECTS = {
    "body": mujoco.mjtObj.mjOBJ_BODY,
    "joint": mujoco.mjtObj.mjOBJ_JOINT,
    "geom": mujoco.mjtObj.mjOBJ_GEOM,
    "pair": mujoco.mjtObj.mjOBJ_PAIR,
    "actuator": mujoco.mjtObj.mjOBJ_ACTUATOR,
    "tendon": mujoco.mjtObj.mjOBJ_TENDON,
    "sensor": mujoco.mjtObj.mjOBJ_SENSOR,
    "site": mujoco.mjtObj.mjOBJ_SITE,
}
_COUNTS = {
    "body": "nbody",
    "joint": "njnt",
    "geom": "ngeom",
    "pair": "npair",
    "actuator": "nu",
    "tendon": "ntendon",
    "sensor": "nsensor",
    "site": "nsite",
}
SLIDE, HINGE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)
_PATTERN = re.compile(r"^(?P<field>[a-z_]+)(\[(?P<index>\d+)\])?$")


@dataclass(frozen=True)
class Cell:
    """``array[..., *index] = sign * value``."""

    array: str
    index: tuple[int | slice, ...]
    sign: float = 1.0


@dataclass(frozen=True)
class Address:
    """One parameter's place in a compiled model.

    Args:
        name: as the user writes it, e.g. ``"joint.hinge.damping"``.
        cells: where its value is written; the first one is where it is read.
        unit: SI unit, empty for a pure number.
    """

    name: str
    cells: tuple[Cell, ...]
    unit: str

    def read(self, model: mujoco.MjModel) -> float:
        """The model's own value [unit]."""
        cell = self.cells[0]
        return cell.sign * float(np.ravel(model_array(model, cell.array)[cell.index])[0])


def model_array(model: mujoco.MjModel, array: str) -> np.ndarray:
    """The array of a compiled model by the name that ``mujoco.batch`` gives it (``opt.gravity``, ``body_mass``)."""
    if array == pseudo_inertia.ARRAY:
        return pseudo_inertia.own(model)
    if array.startswith("opt."):
        return np.atleast_1d(np.asarray(getattr(model.opt, array[4:])))
    return getattr(model, array)


def names(model: mujoco.MjModel, kind: str) -> tuple[str, ...]:
    """Names of the model's elements of one kind, in order of their ids."""
    return tuple(mujoco.mj_id2name(model, _OBJECTS[kind], i) or "" for i in range(getattr(model, _COUNTS[kind])))


def element_id(model: mujoco.MjModel, kind: str, name: str) -> int:
    """Id of a named element.

    Raises:
        BadInput: there is none; names the nearest ones.
    """
    i = mujoco.mj_name2id(model, _OBJECTS[kind], name)
    if i < 0:
        known = [n for n in names(model, kind) if n and n != "world"]
        raise BadInput(f"the model has no {kind} '{name}'", nearest(name, known))
    return i


def resolve(model: mujoco.MjModel, name: str, members: Sequence[str] | None = None) -> Address:
    """The cells that an address stands for.

    Args:
        model: whose cells they are.
        name: the address, or a glob.
        members: the addresses that a glob stands for; those of ``model`` when None.

    Raises:
        BadInput: the address is malformed, or names an element or a field that is not there; names the nearest.
    """
    if is_glob(name):
        return _tied(name, [resolve(model, one) for one in members or expand(model, name)])
    kind, element, field, index = _parse(model, name)
    if kind == "actuator" and field in ("kp", "kv"):
        return Address(name, _servo(model, element, field, name), "")
    columns = FIELDS[kind][field]
    if index is None and len(columns) > 1 and field not in PLAIN:
        raise BadInput(
            f"address '{name}' has {len(columns)} values", f"name one: '{name}[0]' to '{name}[{len(columns) - 1}]'"
        )
    if (index or 0) >= len(columns):
        raise BadInput(f"address '{name}' is past the end", f"the index runs from 0 to {len(columns) - 1}")
    if (flag := LIMITED.get((kind, field))) and not getattr(model, flag)[element_id(model, kind, element)]:
        cure = f'give the {kind} one in the model, {field}="low high"'
        raise BadInput(f"address '{name}': {kind} '{element}' has no such limit", cure)
    column = columns[index or 0]
    return Address(name, (Cell(column.array, _index(model, kind, element, column)),), unit(model, kind, element, field))


def is_glob(name: str) -> bool:
    """Check whether an address stands for several elements."""
    return "*" in name or "?" in name


def expand(model: mujoco.MjModel, name: str) -> tuple[str, ...]:
    """The address of every element that a glob matches, in the model's order; the address itself where it is none.

    Raises:
        BadInput: nothing matches; names the nearest.
    """
    if not is_glob(name):
        return (name,)
    kind, _, rest = name.partition(".")
    pattern, _, field = rest.rpartition(".")
    if kind not in _OBJECTS or not pattern:
        raise BadInput(f"address '{name}' is malformed", f"write <kind>.<glob>.<field> with kind {', '.join(_OBJECTS)}")
    known = [n for n in names(model, kind) if n and (kind, n) != ("body", "world")]
    found = [n for n in known if fnmatchcase(n, pattern)]
    if strange := [n for n in found if is_glob(n)]:
        raise BadInput(
            f"{kind} '{strange[0]}' has * or ? in its name, which stand for any text in an address",
            f"give the {kind} another name in the model",
        )
    if found:
        return tuple(f"{kind}.{n}.{field}" for n in found)
    cure = nearest(pattern.replace("*", ""), known)
    raise BadInput(f"the model has no {kind} that matches '{pattern}'", cure)


def written_out(model: mujoco.MjModel, name: str) -> tuple[str, ...]:
    """:func:`expand`, and ``body.x.inertial`` without an index as all ten of them."""
    found = expand(model, name)
    if not name.endswith(".inertial") or not name.startswith("body."):
        return found
    return tuple(f"{one}[{k}]" for one in found for k in range(pseudo_inertia.SIZE))


def _tied(name: str, parts: Sequence[Address]) -> Address:
    """One value for several addresses; the model's own is read from the first."""
    if units := sorted({part.unit for part in parts if part.unit != parts[0].unit}):
        problem = f"address '{name}' ties {parts[0].unit} to {', '.join(units)}"
        raise BadInput(problem, "tie slide joints and hinges apart")
    return Address(name, tuple(cell for part in parts for cell in part.cells), parts[0].unit)


def unit(model: mujoco.MjModel, kind: str, element: str, field: str) -> str:
    """SI unit of a field; a slide joint's differ from a hinge's."""
    units = UNITS.get((kind, field), "")
    if isinstance(units, str):
        return units
    slide = model.jnt_type[element_id(model, "joint", element)] == SLIDE
    return units[0 if slide else 1]


def _parse(model: mujoco.MjModel, name: str) -> tuple[str, str, str, int | None]:
    kind, _, rest = name.partition(".")
    if kind not in FIELDS:
        near = similar(kind, FIELDS, 1)
        raise BadInput(
            f"address '{name}' starts with '{kind}'",
            f"write <kind>.<name>.<field>[index] with kind {', '.join(FIELDS)}"
            + (f"; nearest: {near[0]}" if near else ""),
        )
    # Names may contain dots: the field is what follows the last one.
    element, _, last = rest.rpartition(".") if kind != "option" else ("", "", rest)
    match = _PATTERN.match(last)
    if match is None or (kind != "option" and not element):
        raise BadInput(
            f"address '{name}' is malformed",
            "write option.<field>[index]" if kind == "option" else f"write {kind}.<name>.<field>[index]",
        )
    if kind != "option":
        element_id(model, kind, element)
    field = match["field"]
    known = [*FIELDS[kind], *(("kp", "kv") if kind == "actuator" else ())]
    if field not in known:
        raise _unknown_field(kind, element, field, name, known)
    return kind, element, field, int(match["index"]) if match["index"] else None


def _unknown_field(kind: str, element: str, field: str, name: str, known: Sequence[str]) -> BadInput:
    if (kind, field) == ("option", "timestep"):
        return BadInput(f"address '{name}' cannot be a parameter", "all worlds share one timestep: set it in the model")
    near = similar(field, known, 1)
    place = f"{kind}.{element}" if element else kind
    nearest = f"nearest: '{place}.{near[0]}'; " if near else ""
    return BadInput(f"address '{name}': a {kind} has no field '{field}'", f"{nearest}known: {', '.join(known)}")


def _index(model: mujoco.MjModel, kind: str, element: str, column: Column) -> tuple[int | slice, ...]:
    tail = () if column.index is None else (column.index,)
    if kind == "option":
        return tail or (0,)
    i = element_id(model, kind, element)
    if column.array.startswith("dof_"):
        width = {mujoco.mjtJoint.mjJNT_FREE: 6, mujoco.mjtJoint.mjJNT_BALL: 3}.get(
            mujoco.mjtJoint(model.jnt_type[i]), 1
        )
        first = int(model.jnt_dofadr[i])
        return (slice(first, first + width), *tail)
    if column.array == "qpos_spring":
        return (scalar_joint(model, element)[0], *tail)
    return (i, *tail)


def scalar_joint(model: mujoco.MjModel, name: str) -> tuple[int, int, int]:
    """(qpos address, dof address, joint id) of a slide or hinge joint.

    Raises:
        BadInput: there is no such joint, or it is a free or ball joint.
    """
    i = element_id(model, "joint", name)
    if model.jnt_type[i] not in (SLIDE, HINGE):
        raise BadInput(f"joint '{name}' is a free or ball joint", "only a slide or hinge joint can carry this")
    return int(model.jnt_qposadr[i]), int(model.jnt_dofadr[i]), i


def movable_body(model: mujoco.MjModel, name: str) -> int:
    """Id of a body that can move.

    Raises:
        BadInput: there is no such body, or it is welded to the world.
    """
    i = element_id(model, "body", name)
    if model.body_weldid[i] == 0:
        raise BadInput(f"body '{name}' is fixed to the world", "name one that a joint moves")
    return i


def movable_site(model: mujoco.MjModel, name: str) -> int:
    """Id of a site on a body that can move.

    Raises:
        BadInput: there is no such site, or its body is welded to the world.
    """
    i = element_id(model, "site", name)
    if model.body_weldid[model.site_bodyid[i]] == 0:
        raise BadInput(f"site '{name}' is fixed to the world", "name one on a body that a joint moves")
    return i


def _servo(model: mujoco.MjModel, element: str, field: str, name: str) -> tuple[Cell, ...]:
    """Cells of kp and kv: position servo f = kp (u - q) - kv v, velocity servo f = kv (u - v)."""
    i = element_id(model, "actuator", element)
    gain, bias = model.actuator_gainprm[i], model.actuator_biasprm[i]
    affine = model.actuator_gaintype[i] == int(mujoco.mjtGain.mjGAIN_FIXED) and model.actuator_biastype[i] == int(
        mujoco.mjtBias.mjBIAS_AFFINE
    )
    position = affine and gain[0] == -bias[1] and gain[0] != 0
    velocity = affine and gain[0] == -bias[2] and gain[0] != 0
    if field == "kp" and position:
        return (Cell("actuator_gainprm", (i, 0)), Cell("actuator_biasprm", (i, 1), -1.0))
    if field == "kv" and position:
        return (Cell("actuator_biasprm", (i, 2), -1.0),)
    if field == "kv" and velocity:
        return (Cell("actuator_gainprm", (i, 0)), Cell("actuator_biasprm", (i, 2), -1.0))
    raise BadInput(
        f"address '{name}': actuator '{element}' is not a {'position' if field == 'kp' else 'position or velocity'} "
        "servo",
        f"use actuator.{element}.gear[0] or .gainprm[0], or make it a <position> in the model",
    )
