"""Names and globs of runs and columns: a name stands for itself first, whatever brackets are in it."""

from __future__ import annotations

from collections.abc import Iterable
from fnmatch import fnmatchcase


def matches(name: str, patterns: Iterable[str]) -> bool:
    """Check whether one of the patterns is the name, or a glob that it fits."""
    return any(name == pattern or fnmatchcase(name, pattern) for pattern in patterns)
