"""A cache of results on disk: named tensors and a line of text, by the digest of a question.

       memo.recall(key) -> the kept result, or None                memo.keep(key, tensors, text)

Files appear whole or not at all, so that several processes may share a folder; one that is damaged counts as not there.
The files that were not used for longest go where all of them together are too large.
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar, final, runtime_checkable

import numpy as np
import torch
from torch import Tensor

from onlinebayes.runs.digest import NoDigest, digest
from onlinebayes.runs.errors import BadInput
from onlinebayes.runs.files import atomic_path

T = TypeVar("T")

FOLDER = "ONLINEBAYES_CACHE"
"""Environment variable: the folder of the memo; ``off`` for none, the user's cache folder when unset."""

LARGEST = 2**30
"""Bytes of all files."""

TEXT = "text"
"""Name of the entry that holds the text."""


@dataclass(frozen=True, eq=False)
class Kept:
    """One kept result: named tensors, and a text."""

    tensors: Mapping[str, Tensor]
    text: str = ""


@runtime_checkable
class Memo(Protocol):
    """Keeps answers by the digest of their questions."""

    def recall(self, key: str) -> Kept | None:
        """Return the result kept under a key; None where nothing was kept."""
        ...

    def keep(self, key: str, kept: Kept) -> None:
        """Keep an answer; never fails."""
        ...


@final
class NoMemo:
    """Keeps nothing."""

    def recall(self, key: str) -> None:
        """Nothing."""
        del key

    def keep(self, key: str, kept: Kept) -> None:
        """Not kept."""
        del key, kept


@final
class FolderMemo:
    """Keeps answers as files of a folder.

    Args:
        folder: made when the first answer is kept.
        largest: bytes of all files together.

    Attributes:
        problem: why nothing is kept any more, in one line; empty where all is well.
    """

    def __init__(self, folder: Path, largest: int = LARGEST) -> None:
        self.folder, self.largest, self.problem = folder, largest, ""

    def recall(self, key: str) -> Kept | None:
        """Return the result kept under a key; None where nothing was kept, or where the file is damaged."""
        path = self.folder / f"{key}.npz"
        try:
            with path.open("rb") as source, np.load(source, allow_pickle=False) as file:
                found = {name: file[name] for name in file.files}
            os.utime(path)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None
        text = str(found.pop(TEXT, ""))
        return Kept({name: torch.from_numpy(rows) for name, rows in found.items()}, text)

    def keep(self, key: str, kept: Kept) -> None:
        """Write an answer; where that fails :attr:`problem` says why, and nothing more is kept."""
        if self.problem:
            return
        rows = {name: tensor.detach().cpu().numpy() for name, tensor in kept.tensors.items()}
        try:
            with atomic_path(self.folder / f"{key}.npz") as temporary, temporary.open("wb") as sink:
                np.savez(sink, **{**rows, TEXT: np.array(kept.text)})  # type: ignore[arg-type]
            self._make_room()
        except (BadInput, OSError) as error:
            self.problem = f"fits are not kept for the next command: {error}"

    def _make_room(self) -> None:
        files = [(path, path.stat()) for path in self.folder.glob("*.npz")]
        spare = sum(stat.st_size for _, stat in files) - self.largest
        for path, stat in sorted(files, key=lambda one: one[1].st_mtime):
            if spare <= 0:
                return
            with suppress(OSError):
                path.unlink(missing_ok=True)
            spare -= stat.st_size


def remembered(
    memo: Memo,
    question: Sequence[object],
    make: Callable[[], T],
    pack: Callable[[T], Kept],
    unpack: Callable[[Kept], T],
) -> T:
    """An answer from the memo, or made and kept there; only made where the question has no digest.

    Args:
        memo: where answers are kept.
        question: all that the answer depends on, its name first.
        make: works the answer out.
        pack, unpack: the answer as it is kept, and back.
    """
    if isinstance(memo, NoMemo):
        return make()
    try:
        key = digest(*question)
    except NoDigest:
        return make()
    if (kept := memo.recall(key)) is not None:
        return unpack(kept)
    answer = make()
    memo.keep(key, pack(answer))
    return answer


def users_memo() -> FolderMemo | NoMemo:
    """The memo of this user's commands."""
    named = os.environ.get(FOLDER, "")
    if named == "off":
        return NoMemo()
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return FolderMemo(Path(named) if named else cache / "onlinebayes")
