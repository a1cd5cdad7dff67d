"""The lines that put a wiring fault right, as keys of a problem file."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any

from onlinebayes.criticism import Wiring


def keys_of(wiring: Wiring) -> dict[str, Any]:
    """The tables that the fault's lines set; nothing where only the measurement table can say it (a comment)."""
    try:
        return tomllib.loads(wiring.lines)
    except tomllib.TOMLDecodeError:  # a header comes twice: the lines were not yet composed for a file
        return {}


def mended(content: Mapping[str, Any], wiring: Wiring) -> dict[str, Any]:
    """A parsed problem file with the fault's lines in it; its other keys stay.

    Args:
        content: the parsed problem file, for which the lines were composed.
        wiring: the fault.
    """
    return _merged(content, keys_of(wiring))


def _merged(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    found = dict(old)
    for key, value in new.items():
        inner = old.get(key, {})
        found[key] = _merged(inner, value) if isinstance(value, Mapping) and isinstance(inner, Mapping) else value
    return found
