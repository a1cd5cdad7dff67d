"""What is being tried, on standard error: one line rewritten on a terminal, plain lines in a log.

A line that ends in a full stop is an answer, not a stage: it stays on the terminal. A stage that says "2 of 5" has a
bar. How many rounds a search will take nobody knows, so that there is none for the whole.
"""

from __future__ import annotations

import re
import shutil
import sys
import textwrap
import time
from types import TracebackType
from typing import final

from onlinebayes.runs import one_line

BAR = 10  # characters
_OF = re.compile(r"\b(\d+) of (\d+)\b")


@final
class Stages:
    """Show each stage as it begins; a context that leaves the terminal's line clean.

    Args:
        label: stands before every line.
    """

    def __init__(self, label: str = "onlinebayes") -> None:
        self.label = label
        self._stream = sys.stderr
        self._live = self._stream.isatty()
        self._start = time.monotonic()
        self._shown = False

    def __enter__(self) -> Stages:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._shown:
            self._stream.write("\r\x1b[K")
            self._stream.flush()
        self._shown = False

    def __call__(self, line: str) -> None:
        """Say that a stage begins, or an answer."""
        line = one_line(line)
        if not self._live:
            self._stream.write(f"{self.label}: {line}\n")
            self._stream.flush()
            return
        width = shutil.get_terminal_size().columns - 1  # a full line would wrap, and a wrapped one is not rewritten
        if line.endswith("."):
            self._stream.write(f"\r\x1b[K{textwrap.fill(line, width, break_long_words=False)}\n")
            self._stream.flush()
            self._shown = False
            return
        text = f"{self.label} [{time.monotonic() - self._start:.0f} s]: {_bar(line)}{line} …"
        self._stream.write(f"\r\x1b[K{text[:width]}")
        self._stream.flush()
        self._shown = True


def _bar(line: str) -> str:
    """How much of it was done when this one began, and the one in hand; empty where the line does not count."""
    if (found := _OF.search(line)) is None:
        return ""
    at, total = (int(number) for number in found.groups())
    if not 1 <= at <= total:
        return ""
    done, now = BAR * (at - 1) // total, max(BAR // total, 1)
    return f"{'█' * done}{'▒' * now}{'░' * (BAR - done - now)} "
