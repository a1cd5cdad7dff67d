"""Checkpoints: one file each, whole or not there, the last few kept, damaged ones passed over.

    checkpoint-000012.pt      torch.save of plain values (tensors, numbers, text, lists, dictionaries)
    checkpoint-000012.json    format, recipe, versions, size and SHA-256 of the other

The JSON file is written last and makes the checkpoint valid. Files are flushed to the disk before they are renamed, and
the folder after, so that what :meth:`Checkpoints.save` has returned survives a kill and a power cut. They are read with
``weights_only=True``: a checkpoint holds no code.
"""

from __future__ import annotations

import hashlib
import io
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from onlinebayes.runs.errors import BadInput
from onlinebayes.runs.files import write_atomic
from onlinebayes.runs.results import versions

FORMAT = 1


@dataclass(frozen=True)
class Checkpoint:
    """What was saved.

    Attributes:
        number: counted from 1.
        state: the values.
        path: the file.
    """

    number: int
    state: dict[str, Any]
    path: Path


class Checkpoints:
    """The checkpoints of one run.

    Args:
        folder: where they lie.
        recipe: which kind of run; another kind's checkpoints are not read.
        keep: how many are kept.
    """

    def __init__(self, folder: str | Path, recipe: str, *, keep: int = 3) -> None:
        if keep < 1:
            raise BadInput(f"keep = {keep}", "keep one checkpoint at least")
        self.folder, self.recipe, self.keep = Path(folder), recipe, keep

    def save(self, state: Mapping[str, Any]) -> Path:
        """Write a checkpoint; when this returns it is on the disk.

        Args:
            state: nested dictionaries, lists and tuples of tensors, numbers, text and None.

        Raises:
            TypeError: something else in the state; says where.
            BadInput: it cannot be written, the disk is full; earlier checkpoints are as they were.
        """
        buffer = io.BytesIO()
        torch.save(plain(state), buffer)
        content = buffer.getvalue()
        manifests = self._manifests()
        # A number of its own: a kill between the two files leaves the checkpoint before it as it was.
        number = int(manifests[0].stem.rpartition("-")[2]) + 1 if manifests else 1
        path = self.folder / f"checkpoint-{number:06d}.pt"
        manifest = {
            "format": FORMAT,
            "recipe": self.recipe,
            "bytes": len(content),
            "sha256": hashlib.sha256(content).hexdigest(),
            "versions": versions(),
        }
        write_atomic(path, content, durable=True)
        write_atomic(path.with_suffix(".json"), json.dumps(manifest, indent=1) + "\n", durable=True)
        self._remove(self._manifests()[self.keep :])
        return path

    def load(self, device: torch.device | str = "cpu") -> Checkpoint | None:
        """The newest whole checkpoint; None where there is none yet. What is passed over is told on standard error.

        Raises:
            BadInput: there are checkpoints, and none of them is whole.
        """
        manifests = self._manifests()
        for manifest in manifests:
            try:
                found = self._read(manifest, device)
            except BadInput as error:
                print(f"{error}; the one before it is tried", file=sys.stderr, flush=True)
                continue
            return found
        if manifests:
            raise BadInput(
                f"none of {len(manifests)} checkpoints is whole", "begin anew in another folder", where=str(self.folder)
            )
        return None

    def _remove(self, manifests: list[Path]) -> None:
        """Remove old checkpoints, and what a kill left behind of one that was never whole."""
        for old in manifests:
            old.unlink(missing_ok=True)
        for path in self.folder.glob("checkpoint-*.pt"):
            if not path.with_suffix(".json").exists():
                path.unlink(missing_ok=True)
        for path in self.folder.glob(".checkpoint-*"):
            path.unlink(missing_ok=True)

    def _manifests(self) -> list[Path]:
        """Newest first."""
        return sorted(self.folder.glob("checkpoint-[0-9]*.json"), reverse=True)

    def _read(self, manifest: Path, device: torch.device | str) -> Checkpoint:
        where, path = str(manifest.with_suffix(".pt")), manifest.with_suffix(".pt")
        try:
            told = json.loads(manifest.read_text("utf-8"))
            content = path.read_bytes()
        except (OSError, ValueError) as error:
            raise BadInput(f"the checkpoint cannot be read: {error}", where=where) from error
        if not isinstance(told, dict) or told.get("format") != FORMAT:
            raise BadInput(f"the checkpoint is of another format than {FORMAT}", where=where)
        if told.get("recipe") != self.recipe:
            raise BadInput(f"the checkpoint is of '{told.get('recipe')}', not of '{self.recipe}'", where=where)
        if told.get("bytes") != len(content) or told.get("sha256") != hashlib.sha256(content).hexdigest():
            raise BadInput(f"the checkpoint is damaged: {len(content)} bytes of {told.get('bytes')}", where=where)
        state = torch.load(io.BytesIO(content), map_location=device, weights_only=True)
        return Checkpoint(int(manifest.stem.rpartition("-")[2]), state, path)


def plain(value: Any, path: str = "state") -> Any:
    """The value with tensors apart from their graph, NumPy numbers and arrays as torch's, and mappings as dictionaries.

    Raises:
        TypeError: what no checkpoint can hold; names the place.
    """
    if isinstance(value, Tensor):
        return value.detach().clone()
    if isinstance(value, np.ndarray):
        return torch.from_numpy(value.copy())
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, Mapping):
        return {_key(key, path): plain(item, f"{path}.{key}") for key, item in value.items()}
    if isinstance(value, list | tuple):
        items = [plain(item, f"{path}[{i}]") for i, item in enumerate(value)]
        return tuple(items) if isinstance(value, tuple) else items
    raise TypeError(
        f"{path} is a {type(value).__name__}; a checkpoint holds tensors, numbers, text, lists, dictionaries"
    )


def _key(key: Any, path: str) -> Any:
    if isinstance(key, str | int):
        return key
    if isinstance(key, tuple):
        return key
    raise TypeError(f"a key of {path} is a {type(key).__name__}; use text or whole numbers")
