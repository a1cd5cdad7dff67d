"""One table of a TOML file that knows where it stands: unknown keys and wrong types become one clear line."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from onlinebayes.runs import BadInput, nearest

_KINDS = {str: "text", bool: "true or false", int: "a whole number", float: "a number", list: "a list", dict: "a table"}


class Section:
    """A TOML table, read key by key.

    Args:
        values: the parsed table.
        file: the problem file, for messages.
        path: the table's own path in the file, e.g. ``"selection"``; empty for the top level.
        known: its keys, or None where they are the user's own names.
        later: keys of the format that this version does not know how to use yet.

    Raises:
        BadInput: a key that is neither known nor one of ``later``, or one of ``later`` with anything in it.
    """

    def __init__(
        self,
        values: Mapping[str, Any],
        file: str,
        path: str = "",
        known: Sequence[str] | None = None,
        later: Sequence[str] = (),
    ) -> None:
        self.values, self.file, self.path = values, file, path
        for key, value in values.items():
            if known is None or key in known:
                continue
            if key in later:
                if value not in ({}, [], ""):
                    raise self.error(key, "not supported by this version", "leave it out")
                continue
            if dotted := _dotted(key, value, known):
                raise self.error(key, "a name with dots that is not in quotes", f'write "{dotted}"')
            raise self.error(key, "unknown key", nearest(key, [*known, *later], most=1, cutoff=0.5))

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def error(self, key: str, problem: str, cure: str = "") -> BadInput:
        """The error that names this file and the key's full path."""
        return BadInput(problem, cure, where=f"{self.file}: {self.full(key)}")

    def full(self, key: str) -> str:
        """The key's path in the file, quoted as TOML needs it."""
        quoted = key if key.replace("_", "").replace("-", "").isalnum() else f'"{key}"'
        return f"{self.path}.{quoted}" if self.path else quoted

    @contextmanager
    def at(self, key: str) -> Iterator[None]:
        """Errors from within name this file and the key's full path."""
        try:
            yield
        except BadInput as error:
            if str(error).startswith(f"{self.file}: "):
                raise  # it names file and key already, and stands nearer to what is wrong
            raise self.error(key, str(error)) from error

    def text(self, key: str, default: str | None = None) -> str:
        """A string that is not empty; required without a default."""
        value = self._get(key, str, default)
        if not value and default is None:
            raise self.error(key, "empty", "give a name")
        return value

    def number(self, key: str, default: float | None = None) -> float | None:
        """A finite number, or the default."""
        value = self.values.get(key, default)
        return None if value is None else self.finite(key, value)

    def finite(self, key: str, value: Any) -> float:
        """``value`` as a float; whole numbers count, booleans and nan do not."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.error(key, f"{_show(value)} is not a number", "write a number without quotes")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self.error(key, f"{number} is not finite", "give a finite number")
        return number

    def whole(self, key: str, default: int | None = None) -> int | None:
        """A whole number, or the default."""
        return self._get(key, int, default) if key in self.values else default

    def flag(self, key: str) -> bool:
        """True or false; false where it is absent."""
        return bool(self._get(key, bool, False))

    def texts(self, key: str, default: Sequence[str] | None = None) -> tuple[str, ...]:
        """A list of strings, each once; required without a default."""
        values = self._get(key, list, None if default is None else list(default))
        for value in values:
            if not isinstance(value, str) or not value:
                raise self.error(key, f"{_show(value)} is no name", 'give a list of texts, e.g. ["a", "b"]')
        if repeated := [value for value in values if values.count(value) > 1]:
            raise self.error(key, f"'{repeated[0]}' stands twice", "name it once")
        return tuple(values)

    def section(self, key: str, known: Sequence[str] | None = None, later: Sequence[str] = ()) -> Section:
        """The table under ``key``, empty where it is absent."""
        value = self._get(key, dict, {})
        return Section(value, self.file, self.full(key), known, later)

    def _get(self, key: str, kind: type, default: Any) -> Any:
        value = self.values.get(key, default)
        if value is None:
            raise BadInput(f"'{self.full(key)}' is missing", f"add it: {_KINDS[kind]}", where=self.file)
        if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
            cure = f'write ["{value}"]' if kind is list and isinstance(value, str) else f"write {_KINDS[kind]}"
            raise self.error(key, f"{_show(value)} is not {_KINDS[kind]}", cure)
        return value


def _dotted(key: str, value: Any, known: Sequence[str]) -> str | None:
    """The known key that ``a.b.c = ..`` without quotes meant, which TOML reads as tables within tables."""
    while isinstance(value, Mapping) and key not in known:
        inner = next((k for k in value if any(name.startswith(f"{key}.{k}") for name in known)), None)
        if inner is None:
            return None
        key, value = f"{key}.{inner}", value[inner]
    return key if key in known else None


def _show(value: Any) -> str:
    try:
        shown = repr(value)
    except RecursionError:  # tables within tables without end
        shown = f"a {type(value).__name__}"
    return shown if len(shown) <= 40 else shown[:37] + "..."
