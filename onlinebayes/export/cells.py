"""Cells of MuJoCo's model that a belief moves, and their values in each of its draws.

    cell(theta) = offset + slope . theta         where that is exact, else only the values at the draws are kept

The library's own writer gives the values (:meth:`.MujocoSimulator.fields`), so that a mass takes its moments along, a
servo's gain its bias, and a payload its body. Cells are named by their element, for other models of the machine have
other numbers. Constants that ``mj_setConst`` derives are cells, too, marked as such: MJX and mjlab do not derive them.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from onlinebayes.simulators.effects import ActuatorDelay
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco.addresses import model_array, names
from onlinebayes.simulators.mujoco.fields import SPEC
from onlinebayes.simulators.mujoco.possible_moments import FIELD as MOMENTS
from onlinebayes.simulators.mujoco.possible_moments import rigid

SAME = 1e-9
"""Relative difference below which two values of a cell are one."""

STEP = 1e-3
"""Of a parameter's range: the step of a slope."""

KINDS = {
    "body": "body",
    "dof": "joint",
    "jnt": "joint",
    "qpos": "joint",
    "geom": "geom",
    "pair": "pair",
    "actuator": "actuator",
    "tendon": "tendon",
    "sensor": "sensor",
    "site": "site",
    "opt.": "option",
}
"""Begin of a field's name -> kind of the element that its rows belong to."""


@dataclass(frozen=True)
class Cell:
    """One number of the model.

    Args:
        field: of ``mjModel``.
        kind: of the element that it belongs to.
        name: of the element; None where it has none, or belongs to the options.
        id: of the element in the exported model.
        row: after the element's first row, where it has several.
        index: behind the row.
        derived: whether ``mj_setConst`` writes it.
        offset, slope: of the straight line in theta; slope None where there is none.
    """

    field: str
    kind: str
    name: str | None
    id: int
    row: int
    index: tuple[int, ...]
    derived: bool = False
    offset: float = 0.0
    slope: Mapping[str, float] | None = None


def cells_of(
    simulator: MujocoSimulator,
    model: mujoco.MjModel,
    mean: Float[np.ndarray, " P"],
    draws: Float[np.ndarray, "N P"],
) -> tuple[tuple[Cell, ...], Float[np.ndarray, "N C"]]:
    """Find the cells, and their values in every draw.

    Args:
        simulator: whose parameters theta has.
        model: the exported one, at the mean.
        mean: of theta [SI].
        draws: of theta [SI].
    """
    fields = _fields(simulator, draws)
    lines = _lines(simulator, mean, draws, fields)
    found: list[Cell] = []
    columns: list[np.ndarray] = []
    for field, values in fields.items():
        base = model_array(model, field)
        for place in _differing(values, base):
            column = _along(values, place)
            found.append(_cell(model, field, place, line=lines[field].at(place, column)))
            columns.append(column)
    own = {(cell.field, cell.id, cell.row, cell.index) for cell in found}
    for cell, column in _derived(model, found, np.array(columns).T.reshape(len(draws), -1)):
        if (cell.field, cell.id, cell.row, cell.index) not in own:
            found.append(cell)
            columns.append(column)
    return tuple(found), np.array(columns).T.reshape(len(draws), len(found))


def _fields(simulator: MujocoSimulator, theta: Float[np.ndarray, "N P"]) -> dict[str, np.ndarray]:
    """Fields (N, ...) that an MJCF holds; moments are such that a body can have them."""
    found = {name: values for name, values in simulator.fields(theta).items() if name in SPEC}
    if MOMENTS in found:
        found[MOMENTS] = np.stack([rigid(moments) for moments in found[MOMENTS]])
    system = simulator.system
    for effect in simulator.effects:
        if isinstance(effect, ActuatorDelay):
            own = np.repeat(system.model.actuator_delay[None], len(theta), axis=0)
            own[:, system.model.actuator(effect.target).id] = system.own(effect, theta)["delay"]
            found["actuator_delay"] = own
    return found


@dataclass(frozen=True)
class _Line:
    """A field as a straight line in theta around its mean.

    Args:
        names: of the parameters.
        mean, draws: of theta.
        here: values at the mean.
        slope: by parameter.
    """

    names: tuple[str, ...]
    mean: Float[np.ndarray, " P"]
    draws: Float[np.ndarray, "N P"]
    here: np.ndarray
    slope: np.ndarray

    def at(self, place: tuple[int, ...], values: Float[np.ndarray, " N"]) -> tuple[float, Mapping[str, float] | None]:
        """Offset and slopes of one cell; no slope where the line is not what the draws hold."""
        slope, here = _along(self.slope, place), self.here[place]
        straight = here + (self.draws - self.mean) @ slope
        if np.abs(straight - values).max() > SAME * max(np.abs(values).max(), 1e-12):
            return float(here), None
        used = {name: float(f"{one:.10g}") for name, one in zip(self.names, slope, strict=True) if one != 0.0}
        return float(here - self.mean @ slope), used


def _lines(
    simulator: MujocoSimulator,
    mean: Float[np.ndarray, " P"],
    draws: Float[np.ndarray, "N P"],
    fields: Mapping[str, np.ndarray],
) -> dict[str, _Line]:
    space = simulator.parameters
    width = np.array([STEP * (space[name].high - space[name].low) for name in space])
    high = np.array([space[name].high for name in space])
    step = np.where(mean + width <= high, width, -width)
    moved = _fields(simulator, np.concatenate([mean[None], mean + np.diag(step)]))
    found = {}
    for field in fields:
        here = moved[field][0]
        raw = (moved[field][1:] - here) / step.reshape(-1, *[1] * here.ndim)
        # Rounding of a difference is no slope.
        slope = np.where(np.abs(raw) * np.abs(step).reshape(-1, *[1] * here.ndim) > SAME * np.abs(here), raw, 0.0)
        found[field] = _Line(tuple(space), mean, draws, here, slope)
    return found


def _differing(values: np.ndarray, base: np.ndarray) -> Iterator[tuple[int, ...]]:
    """Places at which some draw has another value than the model."""
    away = np.abs(values - base.reshape(values.shape[1:])).max(0)
    scale = np.maximum(np.abs(values).max(0), np.abs(base.reshape(values.shape[1:])))
    for place in np.argwhere(away > SAME * scale):
        yield tuple(int(k) for k in place)


def _cell(
    model: mujoco.MjModel,
    field: str,
    place: tuple[int, ...],
    *,
    derived: bool = False,
    line: tuple[float, Mapping[str, float] | None] = (0.0, None),
) -> Cell:
    kind = next(kind for begin, kind in KINDS.items() if field.startswith(begin))
    if kind == "option":
        return Cell(field, kind, None, 0, 0, place, derived, *line)
    row, *index = place
    number, first = row, row
    if field.startswith("dof_"):
        number = int(model.dof_jntid[row])
        first = int(model.jnt_dofadr[number])
    elif field.startswith("qpos"):
        number = int(np.searchsorted(model.jnt_qposadr, row, side="right") - 1)
        first = int(model.jnt_qposadr[number])
    return Cell(field, kind, names(model, kind)[number] or None, number, row - first, tuple(index), derived, *line)


def _derived(
    model: mujoco.MjModel, cells: list[Cell], values: Float[np.ndarray, "N C"]
) -> Iterator[tuple[Cell, Float[np.ndarray, " N"]]]:
    """Cells that follow from these, with their values in every draw."""
    arrays = [name for name in dir(model) if name.startswith(tuple(KINDS)) and _is_real(getattr(model, name))]
    kept: dict[str, list[np.ndarray]] = {name: [] for name in arrays}
    for row in values:
        world = copy.copy(model)
        for cell, value in zip(cells, row, strict=True):
            _write(world, cell, value)
        mujoco.mj_setConst(world, mujoco.MjData(world))
        for name in arrays:
            kept[name].append(getattr(world, name).copy())
    for name in arrays:
        both, base = np.array(kept[name]), getattr(model, name)
        for place in _differing(both, base):
            if name.startswith("body_") and place[0] == 0:
                continue  # the world's own, which a scene with more than the machine has otherwise
            yield _cell(model, name, place, derived=True), _along(both, place)


def _along(values: np.ndarray, place: tuple[int, ...]) -> np.ndarray:
    """One place of every row."""
    return values.reshape(len(values), -1)[:, np.ravel_multi_index(place, values.shape[1:])]


def _is_real(array: object) -> bool:
    return isinstance(array, np.ndarray) and array.dtype.kind == "f" and array.size > 0


def _write(world: mujoco.MjModel, cell: Cell, value: float) -> None:
    if cell.kind == "option":
        name = cell.field.removeprefix("opt.")
        if np.ndim(getattr(world.opt, name)):
            getattr(world.opt, name)[cell.index] = value
        else:
            setattr(world.opt, name, value)
        return
    row = cell.id
    if cell.field.startswith("dof_"):
        row = int(world.jnt_dofadr[cell.id])
    elif cell.field.startswith("qpos"):
        row = int(world.jnt_qposadr[cell.id])
    getattr(world, cell.field)[(row + cell.row, *cell.index)] = value
