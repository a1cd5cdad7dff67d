"""Distributions in a file of their own, and as plain values for a checkpoint.

    save(posterior, "pole.json");    posterior = load("pole.json")

A file is text (JSON): names, bounds and units of the parameters, the distribution, and a checksum of both. A path that
ends in ``.safetensors`` gives the same as arrays in that format. As plain values a distribution is a dictionary of
tensors, numbers and strings; a tag tells which it was. What is drawn after loading is what would have been drawn
before, to the last bit.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
import torch

from onlinebayes.inference.base import Belief
from onlinebayes.inference.changing import ChangingBelief
from onlinebayes.inference.distributions import Box, BoxUniform, FlowDensity, TruncatedMixture
from onlinebayes.inference.distributions.bijection import UnitBijection
from onlinebayes.inference.posterior import Posterior
from onlinebayes.inference.proposals import TruncatedProposal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput, one_line, read_arrays, write_arrays, write_atomic

CONTENT, FORMAT, ARRAYS = "onlinebayes distribution", 1, ".safetensors"

KNOWN = ("uniform", "mixture", "flow", "truncated", "box")
"""Tags of the library's own."""

DTYPES = {"float64": torch.float64, "float32": torch.float32, "int64": torch.int64, "bool": torch.bool}


_KINDS: dict[str, Any] = {}


def register(kind: str, own: type) -> None:
    """Let a distribution of your own be saved, in files and in the checkpoints of a run.

    Args:
        kind: its tag.
        own: a class with ``to_state(self)``, which gives tensors, numbers, strings and dictionaries of them, and with
            ``from_state(space, state)``, a static or class method that reads them back.

    Raises:
        BadInput: the tag stands for another distribution.
    """
    if kind in KNOWN or _KINDS.get(kind, own) is not own:
        raise BadInput(f"the tag {kind!r} stands for another distribution", "choose another one")
    _KINDS[kind] = own


def save(belief: Belief, path: str | Path) -> None:
    """Write a distribution to one file, whole or not at all.

    Args:
        belief: a prior, a posterior (as conditioned; its network is not saved), a changing belief (as it stands; it
            cannot be updated any more) or a proposal.
        path: of the file.

    Raises:
        BadInput: a distribution that no tag stands for, or the file cannot be written.
    """
    space = [(name, *astuple(parameter)) for name, parameter in belief.space.items()]
    if Path(path).suffix == ARRAYS:
        arrays: dict[str, np.ndarray] = {}
        told = {"space": space, "belief": _parted(to_state(belief), arrays)}
        write_arrays(path, CONTENT, arrays, told)
        return
    body = {"space": space, "belief": _written(to_state(belief))}
    text = json.dumps({"content": CONTENT, "format": FORMAT, "sha256": _checksum(body), **body}, ensure_ascii=False)
    write_atomic(path, text + "\n")


def load(path: str | Path, space: ParameterSpace | None = None, *, device: torch.device | str = "cpu") -> Belief:
    """The distribution that :func:`save` wrote.

    Args:
        path: of the file.
        space: of the worlds that it is meant for; theta's columns have to be the same there. Bounds may differ.
        device: of its tensors.

    Raises:
        BadInput: there is no such file, it is damaged, no distribution, of another format, or over other parameters.
    """
    where = str(path)
    if Path(path).suffix == ARRAYS:
        arrays, saved = read_arrays(path, CONTENT)
    else:
        arrays, saved = {}, _checked(_read(Path(path)), where)
    try:
        own = ParameterSpace({name: Parameter(*values) for name, *values in saved["space"]})
        belief = from_state(own, _read_back(saved["belief"], arrays, device))
    except (ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError) as error:
        raise BadInput(f"is damaged: {one_line(str(error))[:200]}", "save it anew", where=where) from error
    if space is not None:
        _check_columns(own, space, where)
    return belief


def _checked(saved: Any, where: str) -> dict[str, Any]:
    """The contents of a text file, of our format and with the right checksum."""
    if not isinstance(saved, dict) or saved.get("content") != CONTENT:
        raise BadInput("holds no distribution", "give a file that onlinebayes.inference.saving.save wrote", where=where)
    if saved.get("format") != FORMAT:
        raise BadInput(
            f"was written in format {saved.get('format')!r}, {FORMAT} is read here",
            "read it with the version of onlinebayes that wrote it",
            where=where,
        )
    if saved.get("sha256") != _checksum({key: saved.get(key) for key in ("space", "belief")}):
        raise BadInput("is damaged: its checksum is another", "copy it anew, or save it anew", where=where)
    return saved


def _read(path: Path) -> Any:
    """Read the contents of the file."""
    where = str(path)
    if not path.is_file():
        raise BadInput("there is no such file", "look at the path", where=where)
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise BadInput(
            f"is cut off, damaged or of another kind: {one_line(str(error))[:100]}",
            "give a whole file that onlinebayes.inference.saving.save wrote",
            where=where,
        ) from error


def _checksum(body: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()


def _written(value: Any) -> Any:
    """Plain values with lists of numbers for tensors; Python writes as many digits as a double needs."""
    if isinstance(value, torch.Tensor):
        return {"dtype": str(value.dtype).removeprefix("torch."), "values": value.tolist()}
    if isinstance(value, Mapping):
        return {key: _written(one) for key, one in value.items()}
    return value


def _parted(value: Any, arrays: dict[str, np.ndarray], name: str = "") -> Any:
    """Plain values, with the names of arrays for tensors; the arrays are put aside."""
    if isinstance(value, torch.Tensor):
        arrays[name] = value.detach().cpu().numpy()
        return {"array": name}
    if isinstance(value, Mapping):
        return {key: _parted(one, arrays, f"{name}.{key}" if name else str(key)) for key, one in value.items()}
    return value


def _read_back(value: Any, arrays: Mapping[str, np.ndarray], device: torch.device | str) -> Any:
    """The inverse of :func:`_written` and of :func:`_parted`."""
    if not isinstance(value, Mapping):
        return value
    if set(value) == {"array"}:
        return torch.from_numpy(arrays[value["array"]]).to(device)
    if set(value) == {"dtype", "values"}:
        return torch.tensor(value["values"], dtype=DTYPES[value["dtype"]], device=device)
    return {key: _read_back(one, arrays, device) for key, one in value.items()}


def _check_columns(saved: ParameterSpace, wanted: ParameterSpace, where: str) -> None:
    """Theta has names for us and columns for a simulator: another order would be taken without a word."""
    have, need = ([f"{name} [{space[name].unit}]" for name in space] for space in (saved, wanted))
    if have != need:
        raise BadInput(
            f"is over {', '.join(have)}; the worlds read {', '.join(need)}",
            "give the space the same parameters in the same order",
            where=where,
        )


def to_state(belief: Belief) -> dict[str, Any]:
    """The distribution as plain values.

    Raises:
        BadInput: a distribution that no tag stands for.
    """
    for kind, own in _KINDS.items():
        if type(belief) is own:
            return {**belief.to_state(), "kind": kind}  # type: ignore[attr-defined]
    if isinstance(belief, Posterior | ChangingBelief):
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
    if isinstance(belief, FlowDensity):
        bijection = belief.bijection
        return {
            "kind": "flow",
            "settings": bijection.settings,
            "weights": bijection.state_dict(),
            "context": belief.context,
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
    raise BadInput(
        f"{type(belief).__name__} cannot be saved; a uniform, a mixture, a flow or a truncated proposal can",
        "register it (onlinebayes.inference.saving.register), or run without saving",
    )


def from_state(space: ParameterSpace, state: Mapping[str, Any]) -> Any:
    """The distribution over ``space`` that :func:`to_state` wrote down.

    Raises:
        BadInput: another number of parameters, an unknown tag, or a flow where zuko is not installed.
    """
    kind = state.get("kind")
    if kind in _KINDS:
        return _KINDS[kind].from_state(space, state)
    if kind == "truncated":
        within = state["within"]
        return TruncatedProposal.restored(
            from_state(space, state["mixture"]), None if within is None else from_state(space, within), state
        )
    if kind not in KNOWN:
        cure = "register its class first (onlinebayes.inference.saving.register)"
        raise BadInput(f"a saved distribution of kind {kind!r}; known: {', '.join(KNOWN)}", cure)
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
    if kind == "flow":
        return FlowDensity(UnitBijection.restored(state["settings"], state["weights"]), state["context"], box)
    return TruncatedMixture(state["log_weights"], state["mean"], state["scale_tril"], box)


def _box(box: Box) -> dict[str, Any]:
    return {"low": box.low, "high": box.high}


def _box_or_belief(within: Any) -> dict[str, Any]:
    return {"kind": "box", **_box(within)} if isinstance(within, Box) else to_state(within)
