"""What long work keeps an eye on: whom to tell where it stands, and whether it is to end."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace

from onlinebayes.runs.interrupt import Interrupt


def _silent(line: str) -> None:
    del line


@dataclass(frozen=True)
class Watch:
    """Handed down through long work; silent and never stopped by default.

    Args:
        say: takes one line of progress.
        interrupt: what asks the work to end; None where nothing does.
    """

    say: Callable[[str], None] = _silent
    interrupt: Interrupt | None = None

    @property
    def stopped(self) -> bool:
        """Whether the work is to end: looked at between its steps."""
        return self.interrupt is not None and self.interrupt.requested

    @property
    def quiet(self) -> Watch:
        """The same without a word."""
        return replace(self, say=_silent)

    @property
    def unstoppable(self) -> Watch:
        """The same for a step that is done as a whole or not at all."""
        return replace(self, interrupt=None)

    def heeded(self) -> AbstractContextManager[None]:
        """A block of which nothing is known before its end: a stop raises :class:`.interrupt.Stopped` there."""
        return nullcontext() if self.interrupt is None else self.interrupt.heeded()

    def giving_up(self) -> AbstractContextManager[None]:
        """A block that a stop leaves at its next replay, and a second Ctrl-C at once; what is known is kept."""
        return nullcontext() if self.interrupt is None else self.interrupt.giving_up()


UNWATCHED = Watch()
"""Silent, and never stopped."""
