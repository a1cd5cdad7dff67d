"""Worlds that begin where they are told, in place of where the task would start them.

| key of a complete state    | shape    | meaning                                                    |
|----------------------------|----------|------------------------------------------------------------|
| those of a simulator       |          | ``"qpos"``, ``"qvel"``, ``("effects", ...)``, ...           |
| ``("task", ...)``          | (N, ...) | what stays within an episode, a goal for one               |
| ``"theta"``                | (N, P)   | parameters of the worlds                                   |
| ``"steps"``                | (N,)     | steps since the episode began                              |

All are optional where worlds begin from it: the task's start fills in what is missing.
"""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase

from onlinebayes.runs import BadInput, nearest


def told_start(tensordict: TensorDictBase | None, key: Any, complete: TensorDict) -> TensorDict:
    """The state under ``key``, checked against a complete one of the same worlds and in its dtypes.

    Raises:
        BadInput: there is no state, it has leaves that are unknown or of another shape, or values that are no numbers.
    """
    given = None if tensordict is None else tensordict.get(key, None)
    if given is None:
        raise BadInput(
            f"reset(set_state=True) without a state under {key!r}",
            "give one as get_state() does; below transforms build the environment with with_state=True; "
            "for theta alone say set_state=False",
        )
    known = {_path(name): value for name, value in complete.items(True, True)}
    leaves = {}
    for name, value in given.items(True, True):
        path = _path(name)
        if path not in known:
            raise BadInput(f"'{'.'.join(path)}' is no part of a state", nearest(".".join(path), _words(known)))
        if value.shape != known[path].shape:
            raise BadInput(
                f"'{'.'.join(path)}' of a state has shape {tuple(value.shape)}", f"give {tuple(known[path].shape)}"
            )
        if not bool(value.isfinite().all()):
            raise BadInput(f"'{'.'.join(path)}' of a state is not finite", "give numbers for every world")
        leaves[path] = value.detach().to(known[path]).clone()
    return TensorDict(leaves, batch_size=complete.batch_size, device=complete.device)


def scatter(values: TensorDict, rows: torch.Tensor, worlds: int) -> TensorDict:
    """The given rows of a state of all worlds; the others are zeros, which a masked reset ignores."""
    leaves = {key: x.new_zeros(worlds, *x.shape[1:]).index_copy_(0, rows, x) for key, x in values.items(True, True)}
    return TensorDict(leaves, batch_size=(worlds,), device=values.device)


def _path(name: Any) -> tuple[str, ...]:
    return (name,) if isinstance(name, str) else tuple(name)


def _words(paths: Any) -> list[str]:
    return [".".join(path) for path in paths]
