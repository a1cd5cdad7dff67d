"""Progress that is also kept: every stage that is said, with the seconds that passed until the next."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import final


@dataclass(frozen=True)
class Timing:
    """One stage of the work, in the words of its line of progress, and how long it took [s]."""

    stage: str
    seconds: float


@final
class Stopwatch:
    """Says a line on, and notes when.

    Args:
        say: what takes the line, if anything does.
    """

    def __init__(self, say: Callable[[str], None] | None = None) -> None:
        self._say = say
        self._lines: list[tuple[str, float]] = []

    def __call__(self, line: str) -> None:
        """Say the line; the stage before it ends here, unless it is the same."""
        if self._lines and self._lines[-1][0] == line:
            return
        self._lines.append((line, time.monotonic()))
        if self._say is not None:
            self._say(line)

    def timings(self) -> tuple[Timing, ...]:
        """Every stage until now."""
        ends = [began for _, began in self._lines[1:]] + [time.monotonic()]
        return tuple(Timing(line, end - began) for (line, began), end in zip(self._lines, ends, strict=True))
