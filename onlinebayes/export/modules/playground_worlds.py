"""Domain randomisation for MuJoCo Playground, drawn from what was learnt of the machine; reads worlds.json beside it.

    ppo.train(..., randomization_fn=worlds_playground.domain_randomize)

Each environment gets one of the 256 joint draws: correlations are kept, and the constants that MuJoCo derives (inverse
weights, subtree masses) are those of that draw. Elements are found by their names, so that the environment's scene may
hold more than the machine. Effects that MuJoCo has no term for stand in LEFT_OUT (effect -> why): a warning names them.
"""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from mujoco import mjx

WORLDS: dict[str, Any] = json.loads((Path(__file__).parent / "worlds.json").read_text(encoding="utf-8"))
CELLS: list[dict[str, Any]] = WORLDS["mujoco"]["cells"]
VALUES: np.ndarray = np.array(WORLDS["mujoco"]["values"], dtype=float)
LEFT_OUT: dict[str, str] = WORLDS["mujoco"]["left_out"] | {
    cell["field"]: "a delay of MuJoCo's actuators, which MJX has not" for cell in CELLS if "delay" in cell["field"]
}

ADDRESSES = {"body": "name_bodyadr", "joint": "name_jntadr"}
"""Arrays of the places of names; the others are called ``name_<kind>adr``."""


def domain_randomize(model: mjx.Model, rng: jax.Array) -> tuple[mjx.Model, Any]:
    """A batch of worlds, one for each key.

    Args:
        model: holds the machine under the names of refined.xml.
        rng: keys (B, 2) or (B,).

    Returns:
        The model with a leading axis of B in the fields that differ, and the axes for ``jax.vmap``.

    Raises:
        KeyError: the model has no element of a name.
    """
    if LEFT_OUT:
        warnings.warn("worlds without " + "; ".join(f"{what}, {why}" for what, why in LEFT_OUT.items()), stacklevel=2)
    number = jax.vmap(lambda key: jax.random.randint(key, (), 0, len(VALUES)))(rng)
    values = jnp.asarray(VALUES)[number]
    changed: dict[str, jax.Array] = {}
    for column, cell in enumerate(CELLS):
        field = cell["field"]
        if "delay" in field or (cell["derived"] and not hasattr(model, field)):
            continue
        if field not in changed:
            own = jnp.atleast_1d(jnp.asarray(_read(model, field)))
            changed[field] = jnp.broadcast_to(own, (len(number), *own.shape))
        changed[field] = changed[field].at[(slice(None), *_index(model, cell))].set(values[:, column])
    changed = {field: own.reshape(len(number), *jnp.shape(_read(model, field))) for field, own in changed.items()}
    axes = jax.tree_util.tree_map(lambda _: None, model)
    return model.tree_replace(changed), axes.tree_replace(dict.fromkeys(changed, 0))


def _read(model: mjx.Model, field: str) -> Any:
    for part in field.split("."):
        model = getattr(model, part)
    return model


def _index(model: mjx.Model, cell: dict[str, Any]) -> tuple[int, ...]:
    """The index of a cell in its array."""
    if cell["kind"] == "option":
        return tuple(cell["index"]) or (0,)
    number = cell["id"] if cell["name"] is None else _number(model, cell["kind"], cell["name"])
    row = number
    if cell["field"].startswith("dof_"):
        row = int(model.jnt_dofadr[number])
    elif cell["field"].startswith("qpos"):
        row = int(model.jnt_qposadr[number])
    return (row + cell["row"], *cell["index"])


def _number(model: mjx.Model, kind: str, name: str) -> int:
    """The id of a named element; names lie in the model one after the other, each ended by a zero."""
    addresses = getattr(model, ADDRESSES.get(kind, f"name_{kind}adr"))
    names = [model.names[start:].split(b"\0", 1)[0].decode() for start in addresses]
    if name not in names:
        raise KeyError(f"the model has no {kind} '{name}'")
    return names.index(name)
