"""Named arrays in one file, with what they mean: a safetensors file and a checksum.

    header of the file:   content, format, about (JSON), sha256 of about and of every array

Any program that reads safetensors reads the arrays. A file holds no code.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from onlinebayes.runs.errors import BadInput
from onlinebayes.runs.files import write_atomic
from onlinebayes.runs.printable import one_line

FORMAT = "1"


def write_arrays(path: str | Path, content: str, arrays: Mapping[str, np.ndarray], about: Mapping[str, Any]) -> None:
    """Write arrays to one file, whole or not at all.

    Args:
        path: of the file.
        content: kind of file; whoever reads it asks for the same.
        arrays: numbers or booleans, by name.
        about: plain values that JSON can hold.

    Raises:
        BadInput: the file cannot be written, or the package safetensors is missing.
    """
    save = _safetensors().numpy.save
    arrays = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    told = json.dumps(dict(about), ensure_ascii=False)
    header = {"content": content, "format": FORMAT, "about": told, "sha256": _checksum(told, arrays)}
    write_atomic(path, save(arrays, metadata=header))


def read_arrays(path: str | Path, content: str) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """The arrays and what is told about them, as :func:`write_arrays` wrote them.

    Raises:
        BadInput: there is no such file, it is damaged, of another kind or of another format.
    """
    package, where = _safetensors(), str(path)
    if not Path(path).is_file():
        raise BadInput("there is no such file", "look at the path", where=where)
    try:
        with package.safe_open(path, framework="np") as file:
            header = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (no mapping)
    except (OSError, ValueError, TypeError, package.SafetensorError) as error:
        raise BadInput(
            f"is cut off, damaged or of another kind: {one_line(str(error))[:100]}", "copy it anew", where=where
        ) from error
    if header.get("content") != content:
        raise BadInput(f"holds no {content}", f"give a file that holds an {content}", where=where)
    if header.get("format") != FORMAT:
        raise BadInput(
            f"was written in format {header.get('format')!r}, {FORMAT} is read here",
            "read it with the version of onlinebayes that wrote it",
            where=where,
        )
    if header.get("sha256") != _checksum(header.get("about", ""), arrays):
        raise BadInput("is damaged: its checksum is another", "copy it anew", where=where)
    return arrays, json.loads(header["about"])


def _checksum(told: str, arrays: Mapping[str, np.ndarray]) -> str:
    found = hashlib.sha256(told.encode())
    for name in sorted(arrays):
        found.update(f"{name}:{arrays[name].dtype}:{arrays[name].shape}:".encode() + arrays[name].tobytes())
    return found.hexdigest()


def _safetensors() -> Any:
    """The package; it is loaded where a file is written or read, not where this module is."""
    try:
        import safetensors
        import safetensors.numpy
    except ImportError as error:
        raise BadInput("the package safetensors is not installed", "pip install safetensors") from error
    return safetensors
