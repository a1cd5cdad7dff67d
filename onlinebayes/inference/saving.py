"""Distributions as plain values, for a checkpoint: a dictionary of tensors, numbers and strings, and back.

A tag tells which distribution it was. What is drawn after loading is what would have been drawn before.

:func:`save` and :func:`load` keep one in a text file of its own (JSON, numbers in double precision), parameters and
bounds included, for another program or a later run:

    prior = load("out/posterior/belief.json", simulator.parameters)
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from onlinebayes.inference.base import Belief
from onlinebayes.inference.distributions import Box, BoxUniform, TruncatedMixture
from onlinebayes.inference.posterior import Posterior
from onlinebayes.inference.proposals import TruncatedProposal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput, write_atomic

SCHEMA = 1


def to_state(belief: Belief) -> dict[str, Any]:
    """The distribution as plain values.

    Raises:
        TypeError: a distribution that no tag stands for.
    """
    if isinstance(belief, Posterior):
        return to_state(belief.distribution)
    if isinstance(belief, BoxUniform):
        return {"kind": "uniform", **_box(belief.box)}
    if isinstance(belief, TruncatedMixture):
        return {
            "kind": "mixture",
            "log_weights": belief.log_weights,
            "mean": belief.mean,
            "scale_tril": belief.scale_tril,
            **_box(belief.box),
        }
    if isinstance(belief, TruncatedProposal):
        within = belief.within
        return {
            "kind": "truncated",
            "mixture": to_state(belief.mixture),
            "within": None if within is None else _box_or_belief(within),
            **belief.values(),
        }
    raise TypeError(f"{type(belief).__name__} cannot be saved; a uniform, a mixture or a truncated proposal can")


def from_state(space: ParameterSpace, state: Mapping[str, Any]) -> Any:
    """The distribution over ``space`` that :func:`to_state` wrote down.

    Raises:
        BadInput: another number of parameters, or an unknown tag.
    """
    kind = state.get("kind")
    if kind == "truncated":
        within = state["within"]
        return TruncatedProposal.restored(
            from_state(space, state["mixture"]), None if within is None else from_state(space, within), state
        )
    if kind not in ("uniform", "mixture", "box"):
        raise BadInput(f"a saved distribution of kind {kind!r}", "known: uniform, mixture, truncated")
    low, high = torch.as_tensor(state["low"]), torch.as_tensor(state["high"])
    if len(low) != len(space):
        raise BadInput(
            f"the saved distribution has {len(low)} parameters, the space {len(space)}: {', '.join(space.names)}",
            "go on with the recipe and the parameters that began the run",
        )
    box = Box(space, low, high)
    if kind == "box":
        return box
    if kind == "uniform":
        return BoxUniform(space, box)
    return TruncatedMixture(state["log_weights"], state["mean"], state["scale_tril"], box)


def save(belief: Belief, path: str | Path) -> None:
    """Write a distribution to a JSON file, whole or not at all.

    Raises:
        TypeError: a distribution that no tag stands for.
        BadInput: the file cannot be written.
    """
    parameters = {name: asdict(bounds) for name, bounds in belief.space.items()}
    content = {"schema": SCHEMA, "parameters": parameters, "distribution": _listed(to_state(belief))}
    write_atomic(path, json.dumps(content, ensure_ascii=False, allow_nan=False) + "\n")


def load(path: str | Path, space: ParameterSpace | None = None) -> Any:
    """The distribution that :func:`save` wrote, in double precision.

    Args:
        path: the file.
        space: the parameters that it has to be of, e.g. a simulator's; those in the file when None.

    Raises:
        BadInput: the file cannot be read, or is of other parameters or bounds.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
        saved = ParameterSpace({name: Parameter(**bounds) for name, bounds in content["parameters"].items()})
        belief = from_state(saved, _tensors(content["distribution"]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError, RuntimeError) as error:
        told = " ".join(str(error).split()) or type(error).__name__
        cure = "name a file that saving.save or onlinebayes posterior wrote"
        raise BadInput(f"no distribution can be read: {told}", cure, where=str(path)) from error
    if space is not None and saved != space:
        known = {**saved, **space}
        differing = [name for name in known if dict(saved).get(name) != dict(space).get(name)]
        which = ", ".join(differing) or "their order"
        raise BadInput(
            f"it is of other parameters or bounds: {which}",
            "load it for the model, and the bounds, that it was made with",
            where=str(path),
        )
    return belief


def _listed(state: Mapping[str, Any]) -> dict[str, Any]:
    """The same with nested lists for tensors; kernels that all have one factor name it once."""
    found: dict[str, Any] = {}
    for key, value in state.items():
        if key == "scale_tril" and bool((value == value[:1]).all()):
            value = value[:1]
        if isinstance(value, Mapping):
            value = _listed(value)
        found[key] = value.tolist() if isinstance(value, Tensor) else value
    return found


def _tensors(state: Mapping[str, Any]) -> dict[str, Any]:
    """The inverse of :func:`_listed`."""
    found: dict[str, Any] = {}
    for key, value in state.items():
        if isinstance(value, Mapping):
            value = _tensors(value)
        found[key] = torch.tensor(value, dtype=torch.float64) if isinstance(value, list) else value
    if "scale_tril" in found:
        found["scale_tril"] = found["scale_tril"].expand(len(found["mean"]), -1, -1)
    return found


def _box(box: Box) -> dict[str, Any]:
    return {"low": box.low, "high": box.high}


def _box_or_belief(within: Any) -> dict[str, Any]:
    return {"kind": "box", **_box(within)} if isinstance(within, Box) else to_state(within)
