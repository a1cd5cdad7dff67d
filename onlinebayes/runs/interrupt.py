"""A clean stop: the first Ctrl-C asks the loop to end, the second ends it at once."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any


class Interrupt:
    """Context in which Ctrl-C sets :attr:`requested` instead of raising.

    A loop looks at ``requested`` between its steps, keeps what it has and returns. A second Ctrl-C raises
    ``KeyboardInterrupt`` as usual, which within :meth:`giving_up` leaves that block only. Outside the main thread,
    where handlers cannot be set, the context does nothing.

    Args:
        message: what the first Ctrl-C prints on standard error; nothing when empty.
    """

    def __init__(self, message: str = "") -> None:
        self.requested, self.message = False, message
        self._previous: Any = None
        self._installed = False

    def __enter__(self) -> Interrupt:
        try:
            self._previous = signal.signal(signal.SIGINT, self._handle)
            self._installed = True
        except ValueError:  # not the main thread
            self._installed = False
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._installed:
            signal.signal(signal.SIGINT, self._previous)

    @contextmanager
    def giving_up(self) -> Iterator[None]:
        """A block that the second Ctrl-C leaves, and after which the work goes on with what it has."""
        try:
            yield
        except KeyboardInterrupt:
            if not self.requested:
                raise

    def _handle(self, _number: int, _frame: FrameType | None) -> None:
        if self.requested:
            raise KeyboardInterrupt
        self.requested = True
        if self.message:
            print(self.message, file=sys.stderr, flush=True)
