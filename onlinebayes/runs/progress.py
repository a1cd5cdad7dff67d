"""One line of progress on standard error, redrawn in a terminal and thinned out in a log."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import TextIO


class Progress:
    """Show where a long piece of work stands.

    Args:
        label: what is being done, e.g. ``"refine"``.
        total: number of steps, where it is known.
        stream: where to write; standard error by default.
        every: least time between two lines when the stream is no terminal [s].
    """

    def __init__(
        self, label: str, total: int | None = None, *, stream: TextIO | None = None, every: float = 5.0
    ) -> None:
        self.label, self.total, self.every = label, total, every
        self._stream = stream or sys.stderr
        self._live = self._stream.isatty()
        self._start = time.monotonic()
        self._last = -float("inf")
        self._width = 0
        self._pending = ""

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def update(self, step: int, message: str = "") -> None:
        """Say that ``step`` of ``total`` is done, with a short message."""
        now = time.monotonic()
        of_total = f"{step}/{self.total}" if self.total else str(step)
        self._pending = f"{self.label} {of_total} [{now - self._start:.0f} s] {message}".rstrip()
        if now - self._last >= (0.1 if self._live else self.every):
            self._draw()
            self._last = now

    def close(self) -> None:
        """Write what has not been shown yet and leave the line."""
        if self._pending:
            self._draw()
        if self._live and self._width:
            self._stream.write("\n")
            self._stream.flush()
        self._width = 0

    def _draw(self) -> None:
        if self._live:
            self._stream.write("\r" + self._pending.ljust(self._width))
            self._width = len(self._pending)
        else:
            self._stream.write(self._pending + "\n")
        self._stream.flush()
        self._pending = ""
