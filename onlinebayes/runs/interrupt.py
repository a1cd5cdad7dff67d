"""A clean stop: the first Ctrl-C or SIGTERM asks the loop to end, a second Ctrl-C ends it at once.

A fit may take minutes. Within a block that heeds the request the next :func:`heed`, which every replay begins with,
raises :class:`Stopped`: nobody between the two needs to know who may ask for a stop.
"""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from types import FrameType, TracebackType
from typing import Any, Protocol, runtime_checkable

from onlinebayes.runs.errors import BadInput


@runtime_checkable
class MayStop(Protocol):
    """Something that may ask work to end."""

    @property
    def requested(self) -> bool:
        """True once the work was asked to end."""
        ...


_HEEDED: ContextVar[MayStop | None] = ContextVar("heeded", default=None)
"""Who may ask the block in hand to end."""


class Stopped(BadInput):
    """Raised in place of a replay where the work is to end.

    Whoever goes on without a fit that diverges goes on without one that was stopped, and then looks whether it is to.
    """

    def __init__(self) -> None:
        super().__init__("stopped before the fit in hand had ended")

    def __reduce__(self) -> tuple[type[Stopped], tuple[()]]:
        return Stopped, ()


def heed() -> None:
    """Raise :class:`Stopped` if the block in hand has been asked to end; nothing outside of such blocks."""
    asking = _HEEDED.get()
    if asking is not None and asking.requested:
        raise Stopped


@contextmanager
def heeding(asking: MayStop) -> Iterator[None]:
    """A block that :func:`heed` ends once a stop is asked for: without it there is nothing to go on with."""
    token = _HEEDED.set(asking)
    try:
        yield
    finally:
        _HEEDED.reset(token)


@contextmanager
def giving_up(asking: MayStop) -> Iterator[None]:
    """The same, after which the work goes on with what it has; a second Ctrl-C leaves it at once."""
    try:
        with heeding(asking):
            yield
    except (KeyboardInterrupt, Stopped):
        if not asking.requested:
            raise


class Grace:
    """A stop that work need not heed for some seconds: what is nearly done comes to its own end, and is kept.

    Args:
        asking: who asks for the stop.
        seconds: from the first look after the request until it is heeded [s].
    """

    def __init__(self, asking: MayStop, seconds: float = 2.0) -> None:
        self._asking, self._seconds = asking, seconds
        self._since: float | None = None

    @property
    def requested(self) -> bool:
        """True once the seconds have passed since the work was asked to end."""
        if not self._asking.requested:
            return False
        now = time.monotonic()
        self._since = now if self._since is None else self._since
        return now - self._since >= self._seconds


class Interrupt:
    """Context in which Ctrl-C and SIGTERM set :attr:`requested` instead of raising.

    A loop looks at ``requested`` between its steps, keeps what it has and returns; what lasts long stops at its next
    replay within :func:`heeding` and :func:`giving_up`. A second Ctrl-C raises ``KeyboardInterrupt`` as usual, which
    within :func:`giving_up` leaves that block only. SIGTERM only ever asks: ``timeout`` sends it to the process and to
    its group, twice at once. Outside the main thread, where handlers cannot be set, the context does nothing.

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

    def heeded(self) -> AbstractContextManager[None]:
        """A block that this may end: :func:`heeding`."""
        return heeding(self)

    def giving_up(self) -> AbstractContextManager[None]:
        """A block that this may end, and the work goes on: :func:`giving_up`."""
        return giving_up(self)

    def _handle(self, number: int, _frame: FrameType | None) -> None:
        if self.requested:
            if number == signal.SIGINT:
                raise KeyboardInterrupt
            return
        self.requested = True
        if self.message:
            print(self.message, file=sys.stderr, flush=True)
