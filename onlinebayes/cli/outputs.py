"""The files of a command's folder: apart from what the command reads, and none left of an earlier command.

A report beside the refined model of another one would be taken for its own.
"""

from __future__ import annotations

import errno
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from onlinebayes.report import NEXT_UNIT, REFINED_FILES, REPORT_FILES
from onlinebayes.runs import BadInput, DiskFull, Lock, NoLocks

NAMES = (*REPORT_FILES, NEXT_UNIT, *REFINED_FILES)
"""All files that ``compare``, ``diagnose`` and ``refine`` write by a name of their own."""


def names_of(command: str) -> tuple[str, ...]:
    """Return the names of the files that ``compare``, ``diagnose`` or ``refine`` writes."""
    return NAMES if command == "refine" else (*REPORT_FILES, NEXT_UNIT)


def check_apart(paths: Sequence[Path], inputs: Mapping[Path, str]) -> None:
    """No file that is to be written is one that is read.

    Args:
        paths: to be written.
        inputs: path -> what it is, e.g. ``"the model"``.

    Raises:
        BadInput: one is the same file, by whatever name.
    """
    for path in paths:
        if what := _same(path, inputs):
            raise BadInput(f"is {what}, and would be written over", "choose another --out", where=str(path))


def clear(folder: Path, written: Sequence[str], inputs: Mapping[Path, str]) -> tuple[str, ...]:
    """Take away what an earlier command left under :data:`NAMES`, but for inputs; returns the names.

    Args:
        folder: the command's.
        written: names of the files that it wrote this time.
        inputs: as for :func:`check_apart`.
    """
    stale = [name for name in NAMES if name not in written and (folder / name).is_file()]
    stale = [name for name in stale if not _same(folder / name, inputs)]
    for name in stale:
        (folder / name).unlink()
    return tuple(stale)


IN_USE = ".onlinebayes-in-use"
"""File of a command's folder while the command is at work; the system frees it when the process ends, however."""


@contextmanager
def writable(folder: Path, names: Sequence[str] = NAMES) -> Iterator[Path]:
    """The folder, made if need be and tried out before the long work; taken away again when nothing was written.

    No other process may use it meanwhile: two commands would leave a report of one beside a model of the other.

    Args:
        folder: the command's.
        names: of the files that it may write.

    Raises:
        BadInput: it is a link, cannot be made or written, or holds a folder of the name of a file to be written;
            another process uses it.
    """
    for link in (folder, *folder.parents):
        if link.is_symlink() and (link == folder or not link.exists()):
            gone = "" if link.exists() else ", which is not there"
            problem = f"is a link to {link.parent / link.readlink()}{gone}"
            raise BadInput(problem, "give --out the folder itself", where=str(link))
    made = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        problem = "is a file, not a folder" if folder.is_file() else f"cannot be written: {error.strerror}"
        if error.errno == errno.ENOSPC:
            raise DiskFull(problem, "make room, or choose another folder", where=str(folder)) from None
        raise BadInput(problem, "give --out a folder that you may write to", where=str(folder)) from None
    for path in (folder / name for name in names):
        if path.is_dir():
            raise BadInput("is a folder, where a file is to be written", "choose another --out", where=str(path))
    lock = Lock(folder / IN_USE)
    with suppress(NoLocks):  # some disks of a network
        lock.acquire()
    try:
        yield folder
    finally:
        lock.discard()
        for parent in made:
            if any(parent.iterdir()):
                break
            parent.rmdir()


def _same(path: Path, inputs: Mapping[Path, str]) -> str:
    """Return the role of a path among the inputs; empty where it is none of them."""
    if not path.exists():
        return ""
    return next((what for other, what in inputs.items() if other.exists() and path.samefile(other)), "")
