"""A clean stop: the first Ctrl-C or SIGTERM asks the loop to end, a second Ctrl-C ends it at once."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any


class Interrupt:
    """Context in which Ctrl-C and SIGTERM set :attr:`requested` instead of raising.

    A loop looks at ``requested`` between its steps, keeps what it has and returns. A second Ctrl-C raises
    ``KeyboardInterrupt`` as usual, which within :meth:`giving_up` leaves that block only. SIGTERM only ever asks:
    ``timeout`` sends it to the process and to its group, twice at once. Outside the main thread, where handlers cannot
    be set, the context does nothing.

    Args:
        message: what the first request prints on standard error; nothing when empty.
    """

    def __init__(self, message: str = "") -> None:
        self.requested, self.message = False, message
        self._previous: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Interrupt:
        for number in (signal.SIGINT, signal.SIGTERM):
            try:
                self._previous[number] = signal.signal(number, self._handle)
            except ValueError:  # not the main thread
                break
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        while self._previous:
            number, handler = self._previous.popitem()
            signal.signal(number, signal.SIG_DFL if handler is None else handler)  # None: not set from Python

    @contextmanager
    def giving_up(self) -> Iterator[None]:
        """A block that the second Ctrl-C leaves, and after which the work goes on with what it has."""
        try:
            yield
        except KeyboardInterrupt:
            if not self.requested:
                raise

    def _handle(self, number: int, _frame: FrameType | None) -> None:
        if self.requested:
            if number == signal.SIGINT:
                raise KeyboardInterrupt
            return
        self.requested = True
        if self.message:
            print(self.message, file=sys.stderr, flush=True)
