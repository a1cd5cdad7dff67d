"""The one error that means: the input is wrong, and here is what to do about it."""

from __future__ import annotations

from onlinebayes.runs.printable import one_line


class BadInput(ValueError):
    """Input that cannot be used; the message is one line with the value, the rule and the cure.

    The command line prints it and exits with status 2. Library code raises it for files, tables, models and bounds
    that come from a user; a programming mistake stays a plain ``ValueError`` or ``TypeError``.
    """

    def __init__(self, problem: str, cure: str = "", *, where: str = "") -> None:
        parts = [f"{where}: " if where else "", problem, f"; {cure}" if cure else ""]
        super().__init__(one_line("".join(parts)))


class DiskFull(BadInput):
    """There is no room for a file; what belongs to it would be half an answer, and no other part can be tried."""


class UnknownName(BadInput, KeyError):
    """A name that a mapping does not hold.

    ``Mapping.get`` and ``in`` answer a ``KeyError`` with their default, a user reads the line of :class:`BadInput`.
    """

    __str__ = BadInput.__str__  # KeyError's would quote the line
