"""Work of several parts, each of which may fail without the others: what failed is noted in one line.

    attempts = Attempts()
    with attempts.attempt("the search"):
        search.run()                                    # whatever it raises is noted, and the work goes on
    page = attempts.made("the page", render, "")        # the same for a value, with what stands in its place

A stop is no failure: :class:`.interrupt.Stopped` and Ctrl-C go through. So does a full disk, on which no part has room.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar, final

from onlinebayes.runs.errors import BadInput, DiskFull
from onlinebayes.runs.interrupt import Stopped
from onlinebayes.runs.printable import one_line

T = TypeVar("T")


@final
class Attempts:
    """Record of the attempts that failed.

    Attributes:
        failed: a line for each failure: what was tried, what it raised, and where.
        errors: what was raised.
    """

    def __init__(self) -> None:
        self.failed: list[str] = []
        self.errors: list[Exception] = []

    @contextmanager
    def attempt(self, what: str) -> Iterator[None]:
        """A block that may fail: it ends there, and what follows goes on."""
        try:
            yield
        except (Stopped, DiskFull):
            raise
        except Exception as error:
            self.note(what, error)

    def made(self, what: str, make: Callable[[], T], otherwise: T) -> T:
        """Return the result of ``make``; ``otherwise`` where it fails."""
        with self.attempt(what):
            return make()
        return otherwise

    def note(self, what: str, error: Exception) -> None:
        """Note that something failed."""
        self.failed.append(line_of(what, error))
        self.errors.append(error)


def line_of(what: str, error: Exception) -> str:
    """``the search failed by a fault of onlinebayes: RuntimeError: sizes differ (scoring.py, line 90)``.

    A bad input is said in its own words.
    """
    if isinstance(error, BadInput):
        return one_line(f"{what} failed: {error}")
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return one_line(f"{what} failed by a fault of onlinebayes: {type(error).__name__}: {error}{place}")
