"""Files that are either whole or not there: written beside their destination, then renamed onto it."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from onlinebayes.runs.errors import BadInput

PARTIAL = ".partial-"
"""Begins the name of every file that is still being written."""


@contextmanager
def atomic_path(destination: str | Path, *, durable: bool = False) -> Iterator[Path]:
    """Give a temporary path to write to; on success it replaces ``destination``, on any error it is removed.

    Args:
        destination: the file to create or replace; missing parent folders are made.
        durable: return only when the file is on the disk, so that it survives a power cut.

    Raises:
        BadInput: the folder cannot be made or written, a folder, a device or a pipe has the file's
            name, or the disk is full.
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
        raise BadInput(
            f"cannot write here: {error.strerror}", "choose a folder you may write to", where=str(destination)
        ) from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        # mkstemp makes files private; give the result the permissions an ordinary open() would have given it.
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        if durable:
            _flush(temporary)
        temporary.replace(destination)
        if durable:
            _flush(destination.parent)
    except OSError as error:
        if error.filename not in (None, str(temporary)):
            raise  # about a file that the block reads
        raise BadInput(
            f"cannot be written: {error.strerror or error}",
            "make room, or choose another folder",
            where=str(destination),
        ) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


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
