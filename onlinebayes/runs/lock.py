"""A lock that one process at a time holds; the system frees it when that process ends, however it ends.

``flock`` on a file that tells who holds it: a file alone would outlive a killed process and block the next one.
"""

from __future__ import annotations

import contextlib
import datetime
import fcntl
import functools
import os
import weakref
from pathlib import Path

from onlinebayes.runs.errors import BadInput


class NoLocks(BadInput):
    """The disk knows no locks."""


class Lock:
    """A lock on a file.

    Args:
        path: made if it is missing; its folder is there.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._handle: int | None = None

    def acquire(self) -> None:
        """Hold the lock from now on.

        Raises:
            BadInput: another process holds it, which is named; the file cannot be written, or not be locked
                (:class:`NoLocks`).
        """
        where = str(self.path.parent)
        try:
            handle = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            raise BadInput(
                f"cannot write here: {error.strerror}", "choose a folder you may write to", where=where
            ) from error
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = os.read(handle, 200).decode(errors="replace").strip() or "another process"
            os.close(handle)
            if not isinstance(error, BlockingIOError):
                raise NoLocks(
                    f"the folder cannot be locked: {error.strerror}", "choose one on a local disk", where=where
                ) from error
            raise BadInput(
                f"the folder is in use by {holder}", "wait for it, or choose another folder", where=where
            ) from error
        if not self._is_there(handle):  # discarded by its holder between the two calls
            os.close(handle)
            self.acquire()
            return
        self._handle = handle
        _followed().add(self)
        # The text only tells others who holds the lock: on a full disk they are not told.
        with contextlib.suppress(OSError):
            os.ftruncate(handle, 0)
            now = datetime.datetime.now().astimezone().isoformat(" ", "seconds")
            os.write(handle, f"process {os.getpid()}, since {now}".encode())

    def discard(self) -> None:
        """Take the file away and let others have a lock on a new one; nothing happens where it is not held."""
        if self._handle is not None:
            with contextlib.suppress(OSError):
                self.path.unlink()
            self.release()

    def _is_there(self, handle: int) -> bool:
        """Check whether an open file is still the one of this path."""
        try:
            return os.path.samestat(os.fstat(handle), os.stat(self.path))
        except OSError:
            return False

    def release(self) -> None:
        """Let others have it; nothing happens where it is not held."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


@functools.cache
def _followed() -> weakref.WeakSet[Lock]:
    """The locks that forked children let go of: with a copy of the handle they would hold on after a kill."""
    locks: weakref.WeakSet[Lock] = weakref.WeakSet()

    def let_go() -> None:
        for lock in list(locks):
            lock.release()

    os.register_at_fork(after_in_child=let_go)
    return locks
