"""The lines that put a wiring fault right, as keys of a problem file."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any


def keys_of(lines: str) -> dict[str, Any]:
    """The keys that such lines set; nothing where only the measurement table can say it (a comment)."""
    try:
        return tomllib.loads(lines)
    except tomllib.TOMLDecodeError:  # a header comes twice: the lines were not yet composed for a file
        return {}


def mended(content: Mapping[str, Any], lines: str) -> dict[str, Any]:
    """A parsed problem file with the lines of a fault, or of a reading, in it; its other keys stay.

    Args:
        content: the parsed problem file, for which the lines were composed.
        lines: as TOML.
    """
    return _merged(content, keys_of(lines))


def _merged(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    found = dict(old)
    for key, value in new.items():
        inner = old.get(key, {})
        found[key] = _merged(inner, value) if isinstance(value, Mapping) and isinstance(inner, Mapping) else value
    return found
