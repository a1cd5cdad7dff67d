"""A watch over long work: it takes the lines of progress and says whether the work is to end."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace

from onlinebayes.runs.interrupt import MayStop, giving_up, heeding
from onlinebayes.runs.side_by_side import processor_time


def _silent(line: str) -> None:
    del line


@dataclass(frozen=True)
class Watch:
    """Handed down through long work; silent and never stopped by default.

    Args:
        say: takes one line of progress.
        interrupt: what asks the work to end; None where nothing does.
        until: processor time [s] at which it is to end; None for no end.
    """

    say: Callable[[str], None] = _silent
    interrupt: MayStop | None = None
    until: float | None = None

    @property
    def stopped(self) -> bool:
        """True if the work is to end: looked at between its steps."""
        return self.spent or (self.interrupt is not None and self.interrupt.requested)

    @property
    def requested(self) -> bool:
        """The same, for blocks that may be asked to end."""
        return self.stopped

    @property
    def spent(self) -> bool:
        """True if the processor time is used up."""
        return self.until is not None and processor_time() >= self.until

    def within(self, budget_s: float | None) -> Watch:
        """The same with so much processor time from now on [s]; None for no end."""
        return replace(self, until=None if budget_s is None else processor_time() + budget_s)

    def heeded(self) -> AbstractContextManager[None]:
        """A block of which nothing is known before its end: a stop raises :class:`.interrupt.Stopped` there."""
        return heeding(self)

    def giving_up(self) -> AbstractContextManager[None]:
        """A block that a stop leaves at its next replay, and a second Ctrl-C at once; what is known is kept."""
        return giving_up(self)


UNWATCHED = Watch()
"""Silent, and never stopped."""
