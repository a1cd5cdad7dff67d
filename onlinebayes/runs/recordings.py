"""Rerun recordings that a kill left without an end: the viewer refuses a file that stops within a message.

A recording is a header of 12 bytes that begins with ``RRF2``, then messages: kind and length, 8 bytes each, and so many
bytes. One that was closed ends with ``RRF2FOOT`` and a number. Source: Rerun's encoding version 2, as written by 0.41.
"""

from __future__ import annotations

import shutil
import struct
from pathlib import Path

from onlinebayes.runs.files import atomic_path

BEGINNING, END = b"RRF2", b"RRF2FOOT"
HEADER, MESSAGE = 12, struct.Struct("<QQ")


def whole_bytes(path: Path) -> int:
    """Length of the part that the viewer can read: all of a closed recording, else up to its last whole message."""
    size = path.stat().st_size
    with path.open("rb") as file:
        beginning = file.read(HEADER)
        file.seek(max(0, size - HEADER))
        if file.read().startswith(END) or not beginning.startswith(BEGINNING):
            return size
        at = HEADER
        while at + MESSAGE.size <= size:
            file.seek(at)
            _, length = MESSAGE.unpack(file.read(MESSAGE.size))
            if at + MESSAGE.size + length > size:
                break
            at += MESSAGE.size + length
    return min(at, size)


def copy_whole(path: Path, destination: Path) -> None:
    """Copy the part that the viewer can read; the destination may be the recording itself."""
    kept = whole_bytes(path)
    with atomic_path(destination) as temporary:
        shutil.copyfile(path, temporary)
        with temporary.open("r+b") as file:
            file.truncate(kept)
