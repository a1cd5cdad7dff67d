"""Files that are either whole or not there: written beside their destination, then renamed onto it."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from onlinebayes.runs.errors import BadInput


@contextmanager
def atomic_path(destination: str | Path) -> Iterator[Path]:
    """Give a temporary path to write to; on success it replaces ``destination``, on any error it is removed.

    Args:
        destination: the file to create or replace; missing parent folders are made.

    Raises:
        BadInput: the folder cannot be made or written, or a folder has the file's name.
    """
    destination = Path(destination)
    if destination.is_dir():
        raise BadInput("is a folder", "give the name of a file", where=str(destination))
    try:
        destination.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(
            prefix=f".{destination.stem}-", suffix=destination.suffix, dir=destination.parent
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
        temporary.replace(destination)
    finally:
        temporary.unlink(missing_ok=True)


def write_atomic(destination: str | Path, content: str | bytes, *, durable: bool = False) -> None:
    """Write ``content`` (text as UTF-8) to ``destination`` atomically; errors as :func:`atomic_path`.

    Args:
        destination, content: what goes where.
        durable: return only when the file is on the disk, so that it survives a power cut.

    Raises:
        BadInput: as :func:`atomic_path`, or the disk is full.
    """
    data = content.encode() if isinstance(content, str) else content
    try:
        with atomic_path(destination) as temporary, temporary.open("wb") as file:
            file.write(data)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        if durable:
            _flush_folder(Path(destination).parent)
    except OSError as error:
        raise BadInput(
            f"cannot be written: {error.strerror}", "make room, or choose another folder", where=str(destination)
        ) from error


def _flush_folder(folder: Path) -> None:
    """Let the disk know of a renamed file."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
