"""Nested values as plain ones, which a checkpoint can hold and which are read back without running any code."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

PLAIN: tuple[Any, ...] = (bool, int, float, complex, bytes)


def plain(value: Any, path: str = "state") -> Any:
    """The value with copies of its tensors, NumPy's numbers and arrays as torch's, and mappings as dictionaries.

    Args:
        value: nested mappings (tensordicts too), lists and tuples of tensors, arrays, numbers, text, bytes and None.
        path: what the value is called in an error.

    Raises:
        TypeError: what no checkpoint can hold; names the place and the type.
    """
    return _plain(value, path, None)


def compact(value: Any, path: str = "state") -> Any:
    """The same without copies: only a part of a larger tensor, or what was met before, is copied."""
    return _plain(value, path, set())


def _plain(value: Any, path: str, met: set[int] | None) -> Any:
    if value is None:
        return None
    if isinstance(value, Tensor):
        return _tensor(value, met)
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in "biufc":
            raise _refused(path, f"NumPy array of {value.dtype}")
        return torch.from_numpy(np.array(value, order="C"))
    if isinstance(value, np.generic):
        return _plain(value.item(), path, met)
    # Members of enumerations and the like are numbers and text too; their classes would not be read back.
    if isinstance(value, str):
        return str.__str__(value)
    for kind in PLAIN:
        if isinstance(value, kind):
            return value if type(value) is kind else kind(value)
    if isinstance(value, Mapping):
        return {_key(key, path): _plain(item, f"{path}.{key}", met) for key, item in value.items()}
    if isinstance(value, list | tuple):
        items = [_plain(item, f"{path}[{i}]", met) for i, item in enumerate(value)]
        return tuple(items) if isinstance(value, tuple) else items
    raise _refused(path, type(value).__name__)


def _tensor(value: Tensor, met: set[int] | None) -> Tensor:
    value = value.detach()
    if type(value) is not Tensor:
        value = value.as_subclass(Tensor)
    if met is None or value.layout != torch.strided:
        return value.clone()
    storage = value.untyped_storage()
    # torch.save writes a whole storage for a part of it, and tensors that share one come back as one.
    if storage.data_ptr() in met or storage.nbytes() != value.numel() * value.element_size():
        return value.clone()
    met.add(storage.data_ptr())
    return value


def _key(key: Any, path: str) -> Any:
    if isinstance(key, tuple):
        return tuple(_key(part, path) for part in key)
    if isinstance(key, str):
        return str.__str__(key)
    if isinstance(key, int):
        return key if type(key) is bool else int(key)
    raise TypeError(f"a key of {path} is a {type(key).__name__}; use text or whole numbers")


def _refused(path: str, kind: str) -> TypeError:
    return TypeError(
        f"{path} is a {kind}; a checkpoint holds tensors, numbers, text, bytes, None, lists, tuples, dictionaries"
    )
