"""Files that are either whole or not there: written beside their destination, then renamed onto it."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from onlinebayes.runs.errors import BadInput, DiskFull

PARTIAL = ".partial-"
"""Begins the name of every file that is still being written."""

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)

LEAST_ROOM = 2**20
"""Free bytes of a disk below which a file that grows is not written on."""

_waiting: ContextVar[dict[Path, Path] | None] = ContextVar("_waiting", default=None)
"""Destination -> what will replace it, within :func:`together`."""


@contextmanager
def together() -> Iterator[None]:
    """Files written within appear when the block ends, in the order in which they were written, or not at all."""
    if _waiting.get() is not None:
        yield
        return
    waiting: dict[Path, Path] = {}
    token = _waiting.set(waiting)
    try:
        yield
        for destination, temporary in waiting.items():
            temporary.replace(destination)
    finally:
        _waiting.reset(token)
        for temporary in waiting.values():
            with suppress(OSError):
                temporary.unlink(missing_ok=True)


@contextmanager
def atomic_path(destination: str | Path, *, durable: bool = False) -> Iterator[Path]:
    """Give a temporary path to write to; on success it replaces ``destination``, on any error it is removed.

    Args:
        destination: the file to create or replace; missing parent folders are made.
        durable: return only when the file is on the disk, so that it survives a power cut.

    Raises:
        BadInput: the folder cannot be made or written, a folder, a device or a pipe has the file's
            name, or the disk is full (:class:`DiskFull`).
    """
    destination = Path(destination)
    if destination.is_dir():
        raise BadInput("is a folder", "give the name of a file", where=str(destination))
    if destination.exists() and not destination.is_file():  # which the rename would put an end to
        raise BadInput("is a device or a pipe", "give the name of a file", where=str(destination))
    try:
        destination.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(
            prefix=f"{PARTIAL}{destination.stem}-", suffix=destination.suffix, dir=destination.parent
        )
    except OSError as error:
        if error.errno in FULL:
            raise _full(error, destination) from error
        raise BadInput(
            f"cannot write here: {error.strerror}", "choose a folder you may write to", where=str(destination)
        ) from error
    os.close(handle)
    temporary, waiting = Path(name), _waiting.get()
    kept = False
    try:
        yield temporary
        # mkstemp makes files private; give the result the permissions an ordinary open() would have given it.
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        if durable:
            _flush(temporary)
        if waiting is not None:
            if (older := waiting.pop(destination, None)) is not None:
                older.unlink(missing_ok=True)
            waiting[destination], kept = temporary, True
            return
        temporary.replace(destination)
        if durable:
            _flush(destination.parent)
    except OSError as error:
        if error.filename not in (None, str(temporary)):
            raise  # about a file that the block reads
        raise _full(error, destination) from error
    finally:
        if not kept:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)


def _full(error: OSError, destination: Path) -> BadInput:
    kind = DiskFull if error.errno in FULL else BadInput
    problem = f"cannot be written: {error.strerror or error}"
    return kind(problem, "make room, or choose another folder", where=str(destination))


def write_atomic(destination: str | Path, content: str | bytes, *, durable: bool = False) -> None:
    """Write ``content`` (text as UTF-8) to ``destination`` atomically; arguments and errors as :func:`atomic_path`."""
    data = content.encode() if isinstance(content, str) else content
    with atomic_path(destination, durable=durable) as temporary:
        temporary.write_bytes(data)


def remove_partial(folder: str | Path) -> None:
    """Remove the files of a folder that a kill left half written; nobody else may be writing there."""
    for path in Path(folder).glob(f"{PARTIAL}*"):
        path.unlink(missing_ok=True)


def _flush(path: Path) -> None:
    """Bring a file's content, or a folder's list of names, to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def check_room(file: Path) -> None:
    """Refuse to write on where the disk is full, for a writer of somebody else that would wait for ever.

    Raises:
        DiskFull: fewer than ``LEAST_ROOM`` bytes are free.
    """
    if shutil.disk_usage(file.parent).free < LEAST_ROOM:
        raise DiskFull(
            f"cannot be written: {os.strerror(errno.ENOSPC)}", "make room, or choose another folder", where=str(file)
        )
