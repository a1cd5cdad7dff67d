"""One line of progress on standard error, redrawn in a terminal and thinned out in a log."""

from __future__ import annotations

import math
import sys
import time
from collections import deque
from types import TracebackType
from typing import TextIO

WINDOW = 30.0
"""Over which the speed is taken [s]."""


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
        self._began: tuple[float, float] | None = None  # step and time of the first update
        self._frames: deque[tuple[float, int]] = deque()

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def update(self, step: float, message: str = "", *, frames: int | None = None) -> None:
        """Say that ``step`` of ``total`` is done, with a short message.

        Args:
            step: whole steps are shown; a part of one tells how far the work in it is.
            message: what is going on.
            frames: simulated so far, in whatever step: then speed and time left are shown too.
        """
        now = time.monotonic()
        of_total = f"{math.floor(step)}/{self.total}" if self.total else str(math.floor(step))
        clock = [f"{now - self._start:.0f} s", *(self._speed(step, now, frames) if frames is not None else [])]
        self._pending = f"{self.label} {of_total} [{', '.join(clock)}] {message}".rstrip()
        if now - self._last >= (0.1 if self._live else self.every):
            self._draw()
            self._last = now

    def _speed(self, step: float, now: float, frames: int) -> list[str]:
        """Frames a second over the last half minute, and the time left at the pace since the first update."""
        self._began = self._began if self._began is not None else (step, now)
        self._frames.append((now, frames))
        while now - self._frames[0][0] > WINDOW and len(self._frames) > 2:
            self._frames.popleft()
        (then, before), told = self._frames[0], []
        if now > then:
            told.append(f"{(frames - before) / (now - then):,.0f} frames/s")
        done, spent = step - self._began[0], now - self._began[1]
        if self.total and done > 0:
            told.append(f"{_span(spent * max(self.total - step, 0) / done)} left")
        return told

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


def _span(seconds: float) -> str:
    """A time to wait, in the unit that people would use."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
