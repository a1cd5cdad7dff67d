"""Suggestions for a wrong name: the cure of a :class:`.errors.BadInput`."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def similar(name: str, known: Iterable[str], most: int = 3, cutoff: float = 0.4) -> list[str]:
    """The known names that are most like a name, best first; those that differ by capitals alone, where there are any.

    Args:
        name: what was written.
        known: what could have been.
        most: how many.
        cutoff: least similarity, 1 being the same (see :func:`difflib.get_close_matches`).
    """
    known = list(known)
    folded = [other for other in known if other.casefold() == name.casefold()]
    return folded or difflib.get_close_matches(name, known, n=most, cutoff=cutoff)


def nearest(name: str, known: Iterable[str], *, most: int = 3, cutoff: float = 0.4, listed: int | None = None) -> str:
    """``nearest: carriage``; where nothing is like the name ``known: carriage, pole``, or ``known: none``.

    Args:
        name, known, most, cutoff: as for :func:`similar`.
        listed: how many known names are said at most where none is similar; all when None.
    """
    known = list(known)
    if near := similar(name, known, most, cutoff):
        return f"nearest: {', '.join(near)}"
    return f"known: {', '.join(known[:listed]) or 'none'}"
