"""Progress of a search on standard error: one line rewritten on a terminal, plain lines in a log.

The number of rounds that a search will take is not known, so that there is no bar.
"""

from __future__ import annotations

import shutil
import sys
import time
from types import TracebackType
from typing import final

from onlinebayes.runs import one_line


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
        """Say that a stage begins; a line that ends in a full stop is an answer, and stays."""
        line = one_line(line)
        if not self._live:
            self._stream.write(f"{self.label}: {line}\n")
            self._stream.flush()
            return
        width = shutil.get_terminal_size().columns - 1  # a full line would wrap, and a wrapped one is not rewritten
        text = f"{self.label} [{time.monotonic() - self._start:.0f} s]: {line}"
        kept = line.endswith(".")
        self._stream.write(f"\r\x1b[K{text}\n" if kept else f"\r\x1b[K{f'{text} …'[:width]}")
        self._stream.flush()
        self._shown = not kept
