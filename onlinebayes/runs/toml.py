"""A small TOML writer (the standard library only reads it): tables, strings, numbers, booleans, arrays, comments.

to_toml(tomllib.loads(text)) parses to the same values; comments of the original are not kept.
"""

from __future__ import annotations

import datetime
import json
import math
import re
from collections.abc import Mapping
from typing import Any

from onlinebayes.runs.printable import one_line

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def to_toml(
    content: Mapping[str, Any], *, head: str = "", comments: Mapping[tuple[str, ...], str] | None = None
) -> str:
    """TOML text of ``content``.

    Args:
        content: tables nested as ``tomllib`` gives them.
        head: comment before the first line.
        comments: path of a key -> comment behind its value.
    """
    lines = [f"# {line}" for line in head.split("\n")] if head else []
    _table(lines, (), content, comments or {})
    return "\n".join(lines) + "\n"


def _table(
    lines: list[str], path: tuple[str, ...], table: Mapping[str, Any], comments: Mapping[tuple[str, ...], str]
) -> None:
    inner = {key: value for key, value in table.items() if _is_table(value, path)}
    plain = {key: value for key, value in table.items() if key not in inner}
    if path and (plain or not inner):
        lines += ["", f"[{'.'.join(_key(part) for part in path)}]"]
    for key, value in plain.items():
        comment = comments.get((*path, key), "")
        lines.append(f"{_key(key)} = {_value(value)}{f'  # {one_line(comment)}' if comment else ''}")
    for key, value in inner.items():
        _table(lines, (*path, key), value, comments)


def _is_table(value: Any, path: tuple[str, ...]) -> bool:
    """Check whether a value gets a header of its own: mappings, but small ones two levels down stay on one line."""
    return isinstance(value, Mapping) and not (path and path[0] == "parameters")


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else _string(key)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _string(value)
    if isinstance(value, float):
        return _float(value)
    if isinstance(value, (int, datetime.date, datetime.time)):
        return value.isoformat() if isinstance(value, (datetime.date, datetime.time)) else str(value)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    raise TypeError(f"TOML has no {type(value).__name__}")


def _float(value: float) -> str:
    if not math.isfinite(value):
        return "nan" if math.isnan(value) else "inf" if value > 0 else "-inf"
    return repr(float(value))


def _string(text: str) -> str:
    # JSON's escapes are TOML's too, but for DEL, which TOML wants escaped.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
