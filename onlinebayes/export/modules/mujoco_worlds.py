"""Worlds of plain MuJoCo, drawn from what was learnt of the machine; reads worlds.json and refined.xml beside it.

    rng = numpy.random.default_rng(0)
    model = sample_world(rng)                   # a mujoco.MjModel with one joint draw of all parameters written
    model = sample_world(rng, how="normal")     # from the normal distribution cut off at the bounds, not the 256 draws
    model = sample_world(rng, model=scene)      # in a scene of your own that holds the machine, elements by their names

Effects that MuJoCo has no term for stand in LEFT_OUT (effect -> why). While there are any, ``sample_world`` raises
NotImplementedError, unless ``without_left_out=True`` says that their lack is known. Needs numpy and mujoco alone.
"""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np

FOLDER = Path(__file__).parent
WORLDS: dict[str, Any] = json.loads((FOLDER / "worlds.json").read_text(encoding="utf-8"))
NAMES: tuple[str, ...] = tuple(WORLDS["parameters"])
DRAWS: np.ndarray = np.array(WORLDS["draws"], dtype=float).reshape(-1, len(NAMES))
CELLS: list[dict[str, Any]] = [cell for cell in WORLDS["mujoco"]["cells"] if not cell["derived"]]
VALUES: np.ndarray = np.array(WORLDS["mujoco"]["values"], dtype=float)[
    :, [not cell["derived"] for cell in WORLDS["mujoco"]["cells"]]
]
LEFT_OUT: dict[str, str] = WORLDS["mujoco"]["left_out"]

TRIES = 10_000
"""Draws of the normal distribution after which one that is within the bounds is given up."""


def sample_world(
    rng: np.random.Generator,
    how: Literal["draws", "normal"] = "draws",
    model: mujoco.MjModel | None = None,
    *,
    without_left_out: bool = False,
) -> mujoco.MjModel:
    """A world with parameters drawn together.

    Args:
        rng: decides the draw.
        how: ``"draws"`` takes one of the 256 joint draws, ``"normal"`` draws anew, see :func:`sample_theta`.
        model: holds the machine under the same names; refined.xml when None. It is not changed.
        without_left_out: whether worlds without the effects in LEFT_OUT are wanted.

    Raises:
        NotImplementedError: MuJoCo has no term for an effect, or "normal" cannot compute a field.
    """
    if LEFT_OUT and not without_left_out:
        listed = "; ".join(f"{effect}, {why}" for effect, why in LEFT_OUT.items())
        raise NotImplementedError(f"worlds without {listed}: pass without_left_out=True to train without")
    if how == "draws":
        return written(VALUES[rng.integers(len(VALUES))], model)
    return world(sample_theta(rng), model)


def sample_theta(rng: np.random.Generator) -> np.ndarray:
    """Parameters (P,) [SI, in the order of NAMES] from the normal distribution, cut off at the bounds.

    Raises:
        NotImplementedError: the log leaves several models open, which no normal distribution is.
    """
    if len(WORLDS["models"]) > 1:
        raise NotImplementedError('several models are open: how="draws" draws from all of them')
    of = list(WORLDS["parameters"].values())
    mean, sd, low, high = (np.array([one[key] for one in of], dtype=float) for key in ("mean", "sd", "low", "high"))
    covariance = sd[:, None] * np.array(WORLDS["correlation"], dtype=float).reshape(len(sd), len(sd)) * sd
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    for _ in range(TRIES):
        theta = mean + root @ rng.standard_normal(len(mean))
        if bool(((low <= theta) & (theta <= high)).all()):
            return theta
    return np.clip(mean, low, high)


def world(theta: np.ndarray, model: mujoco.MjModel | None = None) -> mujoco.MjModel:
    """The world of given parameters (P,) [SI, in the order of NAMES].

    Raises:
        NotImplementedError: a field is no straight line in the parameters; the draws hold it.
    """
    if curved := sorted({cell["field"] for cell in CELLS if cell["slope"] is None}):
        raise NotImplementedError(f'{", ".join(curved)} bend with the parameters: use how="draws"')
    values = dict(zip(NAMES, theta, strict=True))
    found = [c["offset"] + sum(slope * values[name] for name, slope in c["slope"].items()) for c in CELLS]
    return written(np.array(found), model)


def written(values: np.ndarray, model: mujoco.MjModel | None = None) -> mujoco.MjModel:
    """A copy of the model with values in CELLS, and the constants that follow from them."""
    base = mujoco.MjModel.from_xml_path(str(FOLDER / WORLDS["mujoco"]["model"])) if model is None else model
    changed = copy.copy(base)
    for cell, value in zip(CELLS, values, strict=True):
        array, index = place(changed, cell)
        array[index] = value
    mujoco.mj_setConst(changed, mujoco.MjData(changed))
    return changed


def place(model: mujoco.MjModel, cell: dict[str, Any]) -> tuple[np.ndarray, tuple[int, ...]]:
    """The array of a cell in a model, and the index in it.

    Raises:
        KeyError: the model has no element of that name.
    """
    if cell["kind"] == "option":
        array, name = np.atleast_1d(getattr(model.opt, cell["field"][4:])), cell["field"][4:]
        return (array, tuple(cell["index"])) if array.base is not None else (_Scalar(model.opt, name), (0,))  # type: ignore[return-value]
    number = (
        cell["id"]
        if cell["name"] is None
        else mujoco.mj_name2id(model, getattr(mujoco.mjtObj, f"mjOBJ_{cell['kind'].upper()}"), cell["name"])
    )
    if number < 0:
        raise KeyError(f"the model has no {cell['kind']} '{cell['name']}'")
    row = int(number)
    if cell["field"].startswith("dof_"):
        row = int(model.jnt_dofadr[number])
    elif cell["field"].startswith("qpos"):
        row = int(model.jnt_qposadr[number])
    return getattr(model, cell["field"]), (row + cell["row"], *cell["index"])


class _Scalar:
    """A number of the options, written like an array."""

    def __init__(self, options: Any, name: str) -> None:
        self.options, self.name = options, name

    def __setitem__(self, index: object, value: float) -> None:
        setattr(self.options, self.name, float(value))

    def __getitem__(self, index: object) -> float:
        return float(getattr(self.options, self.name))
