"""The lines that mend a wiring fault, with what the problem file says of those columns already.

Criticism knows the model's quantities, y = scale cell + offset; a fault says what is to be done to them. In the file

    y' = f y        ->  scale' = f scale,  offset' = f offset
    y' = y + d      ->  offset' = offset + d
    y' = y(t + T)   ->  latency' = latency + T
    x' = y          ->  the column of y, and all that the file says of it

The lines hold the keys that change, with the values that they get; a comment, which no key can say, stays as it is.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from typing import Any

from onlinebayes.measurements.matching import matches
from onlinebayes.measurements.units import SI
from onlinebayes.runs import to_toml

Table = dict[str, Any]
_HEADER = re.compile(r"\[(signals|commands)\.")
_NEUTRAL = {"sign": 1, "scale": 1.0, "offset": 0.0, "latency": 0.0}


def composed(lines: str, content: Mapping[str, Any]) -> str:
    """The fault's lines for this file.

    Args:
        lines: as the fault has them: headers of ``[signals]`` or ``[commands]``, a key under each.
        content: the parsed problem file.
    """
    parts = [part.strip() for part in re.split(r"^(?=\[)", lines, flags=re.MULTILINE) if part.strip()]
    if not parts or not all(_HEADER.match(part) for part in parts):
        return lines
    asked: dict[tuple[str, str], Table] = {}
    for part in parts:  # one by one: a header may come twice
        ((kind, tables),) = tomllib.loads(part).items()
        ((name, values),) = tables.items()
        asked.setdefault((kind, name), {}).update(values)
    found: dict[str, dict[str, Table]] = {}
    for (kind, name), values in asked.items():
        found.setdefault(kind, {})[name] = _changed(kind, name, values, content.get(kind, {}))
    return to_toml(found).strip()


def _changed(kind: str, name: str, asked: Table, tables: Mapping[str, Table]) -> Table:
    """The keys of one table that change."""
    before = _said_of(name, tables)
    now, own = dict(before), "ctrl." if kind == "commands" else ""
    if "column" in asked:
        other = asked["column"].removeprefix(own)
        there = _said_of(other, tables)
        now = {"column": asked["column"], **there}
    sign, factor = asked.get("sign", 1), asked.get("scale", 1.0)
    if sign != 1:
        now["sign"] = int(sign * now.get("sign", 1))
    if factor != 1.0:
        now["scale"] = _rounded(factor * now.get("scale", 1.0))
    if "offset" in now:
        now["offset"] = _rounded(sign * factor * now["offset"])
    for key in ("offset", "latency"):
        if key in asked:
            now[key] = _rounded(now.get(key, 0.0) + asked[key])
    changed = {key: value for key, value in now.items() if before.get(key) != value}
    gone = {key: _undone(key, before[key]) for key in before if key not in now and key != "column"}
    return {**changed, **{key: value for key, value in gone.items() if value is not None}}


def _said_of(name: str, tables: Mapping[str, Table]) -> Table:
    """The keys that hold for a name: of the globs that it fits, then of its own table."""
    globs = [table for glob, table in tables.items() if glob != name and matches(name, (glob,))]
    return {key: value for table in (*globs, tables.get(name, {})) for key, value in table.items()}


def _rounded(value: float) -> float:
    return float(f"{value:.9g}")


def _undone(key: str, value: Any) -> Any:
    """Return the value that undoes a key which no longer holds; None where it may stay."""
    return SI[value][0] if key == "unit" and value in SI else _NEUTRAL.get(key)
