"""Checkpoints: one file each, whole or not there, the last few kept, damaged ones passed over.

    checkpoint-000012.pt      torch.save of plain values (tensors, numbers, text, lists, dictionaries)
    checkpoint-000012.json    format, recipe, versions, size and SHA-256 of the other

The JSON file is written last and makes the checkpoint valid. Files are flushed to the disk before they are renamed, and
the folder after, so that what :meth:`Checkpoints.save` has returned survives a kill and a power cut. They are read with
``weights_only=True``: a checkpoint holds no code.
"""

from __future__ import annotations

import hashlib
import json
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import torch

from onlinebayes.runs.errors import BadInput
from onlinebayes.runs.files import atomic_path, write_atomic
from onlinebayes.runs.plain import compact
from onlinebayes.runs.plain import plain as plain
from onlinebayes.runs.printable import one_line
from onlinebayes.runs.results import versions

FORMAT = 1
_NAME = re.compile(r"checkpoint-(\d{6,})\.(pt|json)")


@dataclass(frozen=True)
class Checkpoint:
    """A saved state and the file that holds it.

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
        keep: how many whole ones are kept.
    """

    def __init__(self, folder: str | Path, recipe: str, *, keep: int = 3) -> None:
        if keep < 1:
            raise BadInput(f"keep = {keep}", "keep one checkpoint at least")
        self.folder, self.recipe, self.keep = Path(folder), recipe, keep

    def save(self, state: Mapping[str, Any]) -> Path:
        """Write a checkpoint; when this returns it is on the disk.

        The tensors are written as they lie in memory, without another copy.

        Args:
            state: nested mappings, lists and tuples of tensors, arrays, numbers, text, bytes and None.

        Raises:
            TypeError: something else in the state; says where.
            BadInput: it cannot be written, the disk is full; earlier checkpoints are as they were.
        """
        values = compact(state)
        # A number of its own: a kill between the two files leaves the checkpoint before it as it was.
        number = max(self._numbers("json"), default=0) + 1
        path = self._path(number)
        try:
            with atomic_path(path, durable=True) as temporary, temporary.open("wb") as file:
                sink = _Sink(file)
                torch.save(values, sink)  # type: ignore[arg-type]
                if sink.failed is not None:
                    raise sink.failed
            manifest = {
                "format": FORMAT,
                "recipe": self.recipe,
                "bytes": sink.size,
                "sha256": sink.digest.hexdigest(),
                "versions": versions(),
            }
            write_atomic(path.with_suffix(".json"), json.dumps(manifest, indent=1) + "\n", durable=True)
        except BaseException:
            path.with_suffix(".json").unlink(missing_ok=True)
            path.unlink(missing_ok=True)
            raise
        self._rotate(number)
        return path

    def load(self, device: torch.device | str | None = "cpu") -> Checkpoint | None:
        """The newest whole checkpoint; None where there is none yet. What is passed over is told on standard error.

        Args:
            device: of all tensors; with None each returns to the one it was saved on.

        Raises:
            BadInput: there are checkpoints, and none of them is whole.
        """
        problems: list[str] = []
        for number in self._numbers("json"):
            try:
                found = self._read(number, device)
            except BadInput as error:
                problems.append(str(error))
                continue
            for problem in problems:
                print(f"{problem}; {found.path.name} is used instead", file=sys.stderr, flush=True)
            return found
        if problems:
            raise BadInput(
                f"none of {len(problems)} checkpoints can be used; the newest: {problems[0]}",
                "begin anew in another folder",
                where=str(self.folder),
            )
        return None

    def _rotate(self, newest: int) -> None:
        """Remove what is older than the last whole ones, and what a kill left of one that was never whole."""
        whole = [number for number in self._numbers("json") if self._size_is_right(number)][: self.keep]
        for number in self._numbers("json"):
            if number < whole[-1]:
                self._path(number).with_suffix(".json").unlink(missing_ok=True)
        known = set(self._numbers("json"))
        for number in self._numbers("pt"):
            if number <= newest and number not in known:
                self._path(number).unlink(missing_ok=True)

    def _numbers(self, suffix: str) -> list[int]:
        """Of the files with this suffix, newest first."""
        matches = (_NAME.fullmatch(path.name) for path in self.folder.glob(f"checkpoint-*.{suffix}"))
        return sorted((int(match[1]) for match in matches if match), reverse=True)

    def _path(self, number: int) -> Path:
        return self.folder / f"checkpoint-{number:06d}.pt"

    def _size_is_right(self, number: int) -> bool:
        path = self._path(number)
        try:
            return bool(json.loads(path.with_suffix(".json").read_text("utf-8"))["bytes"] == path.stat().st_size)
        except (OSError, ValueError, KeyError, TypeError):
            return False

    def _read(self, number: int, device: torch.device | str | None) -> Checkpoint:
        path = self._path(number)
        where = str(path)
        try:
            told = json.loads(path.with_suffix(".json").read_text("utf-8"))
            size = path.stat().st_size
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
        except (OSError, ValueError) as error:
            raise BadInput(f"the checkpoint cannot be read: {error}", where=where) from error
        if not isinstance(told, dict) or told.get("format") != FORMAT:
            raise BadInput(f"the checkpoint is of another format than {FORMAT}", where=where)
        if told.get("recipe") != self.recipe:
            raise BadInput(f"the checkpoint is of '{told.get('recipe')}', not of '{self.recipe}'", where=where)
        if told.get("bytes") != size:
            raise BadInput(f"the checkpoint is damaged: {size} bytes of {told.get('bytes')}", where=where)
        if told.get("sha256") != digest:
            raise BadInput("the checkpoint is damaged: its checksum is another", where=where)
        try:
            state = torch.load(path, map_location=device, weights_only=True)
        except Exception as error:  # whatever the bytes make torch meet
            raise BadInput(f"torch cannot read the checkpoint: {one_line(str(error))[:200]}", where=where) from error
        return Checkpoint(number, state, path)


class _Sink:
    """A file for ``torch.save`` that adds up size and checksum, and keeps an error for later.

    An error within ``torch.save`` comes out as another one, of torch's archive writer.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self.size, self.digest = 0, hashlib.sha256()
        self.failed: OSError | None = None

    def write(self, content: bytes | memoryview) -> int:
        """Write on, unless that has failed before."""
        if self.failed is None:
            try:
                self._file.write(content)
            except OSError as error:
                self.failed = error
        self.digest.update(content)
        size = memoryview(content).nbytes
        self.size += size
        return size

    def flush(self) -> None:
        """Nothing waits here."""
