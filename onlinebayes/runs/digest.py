"""A digest of values: equal for equal values, in every process and on every machine.

    digest = SHA-256 of the values taken apart: numbers, text, tensors and their containers as they are, objects of this
             library as what ``pickle`` would take them apart into, and this library's own source

An object of another library, or of a user's module, has no digest: nobody knows whether its code is still the same.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from enum import Enum
from functools import cache, partial
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, MethodType
from typing import Any, Protocol, runtime_checkable

import numpy as np
import torch
from tensordict import TensorDictBase

from onlinebayes.runs.results import versions

VOUCHED = ("onlinebayes", "builtins", "copyreg", "torch", "tensordict", "numpy", "mujoco", "collections", "functools")
"""Packages whose source or version is part of every digest, and those of Python itself."""

DEEPEST = 60
"""Objects within objects: what lies deeper goes round in a circle."""


class NoDigest(TypeError):
    """A value whose meaning cannot be told from its parts."""


@runtime_checkable
class _Hash(Protocol):
    def update(self, data: bytes, /) -> None: ...


def digest(*values: object) -> str:
    """The digest of some values, in hexadecimal.

    Raises:
        NoDigest: one of them holds an object of somebody else's code.
    """
    found = hashlib.sha256(_library())
    _feed(found, values, 0)
    return found.hexdigest()


def source_digest(folders: Iterable[Path]) -> str:
    """Digest of all ``.py`` and ``.xml`` files below some folders, in hexadecimal."""
    found = hashlib.sha256()
    for top in folders:
        for path in sorted(path for path in top.rglob("*") if path.suffix in (".py", ".xml")):
            found.update(str(path.relative_to(top)).encode() + path.read_bytes())
    return found.hexdigest()


@cache
def _library() -> bytes:
    """Digest of this library's source, and of what it computes with."""
    found = hashlib.sha256(source_digest([Path(__file__).parents[1]]).encode())
    found.update(" ".join(f"{name} {number}" for name, number in versions().items()).encode())
    return found.digest()


def _feed(found: _Hash, value: object, depth: int) -> None:
    if depth > DEEPEST:
        raise NoDigest("objects that hold each other have no digest")
    below = partial(_feed, found, depth=depth + 1)
    if isinstance(value, float):  # numpy's, too
        found.update(f"float:{float(value)!r};".encode())
    elif value is None or isinstance(value, bool | int | complex | str | Path):
        found.update(f"{type(value).__name__}:{value!r};".encode())
    elif isinstance(value, bytes):
        found.update(b"bytes:" + str(len(value)).encode() + b":" + value)
    elif isinstance(value, torch.Tensor | np.ndarray):
        rows = value.detach().cpu().numpy() if isinstance(value, torch.Tensor) else value
        if rows.dtype.hasobject:
            raise NoDigest("an array of objects has no digest")
        found.update(
            f"{type(value).__name__}:{rows.dtype}:{rows.shape}:".encode() + np.ascontiguousarray(rows).tobytes()
        )
    elif isinstance(value, TensorDictBase):
        found.update(f"tensordict:{tuple(value.batch_size)};".encode())
        below(dict(value.items()))
    elif isinstance(value, set | frozenset):
        found.update(f"set:{len(value)};".encode())
        for one in sorted(map(digest, value)):
            below(one)
    elif type(value) is dict or (isinstance(value, Mapping) and type(value).__module__ == "builtins"):
        found.update(f"dict:{len(value)};".encode())
        for pair in value.items():
            below(pair)
    elif type(value) in (list, tuple):
        found.update(f"{type(value).__name__}:{len(value)};".encode())  # type: ignore[arg-type]
        for one in value:  # type: ignore[attr-defined]
            below(one)
    elif isinstance(value, Enum):
        below((type(value), value.name))
    elif isinstance(value, MethodType):
        below((value.__func__, value.__self__))
    elif isinstance(value, type | FunctionType | BuiltinFunctionType):
        found.update(f"name:{_name(value)};".encode())
    else:
        below(_parts(value))


def _name(value: Any) -> str:
    """Of a class or a function of a module that this digest vouches for."""
    module, name = value.__module__ or "builtins", value.__qualname__
    if module.partition(".")[0] not in VOUCHED:
        raise NoDigest(f"{module}.{name}: its code may change")
    if "<" in name:
        raise NoDigest(f"{module}.{name} has no name of its own")
    return f"{module}.{name}"


def _parts(value: object) -> tuple[Any, ...]:
    """Split an object into its parts, as for a pickle."""
    _name(type(value))
    try:
        parts = value.__reduce_ex__(4)
    except TypeError as error:
        raise NoDigest(str(error)) from error
    if isinstance(parts, str):
        raise NoDigest(f"{parts} is one of its kind")
    return tuple(list(one) if one is not None and hasattr(one, "__next__") else one for one in parts)
