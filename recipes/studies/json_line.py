"""A frozen record as one line of JSON, so that what a study has done can be kept, published and gone on from.

parsed(type(record), line(record), ...) == record; keys that a record no longer has are passed over.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, fields
from typing import Any, TypeVar

Record = TypeVar("Record")


def line(record: Any) -> str:
    """The fields of a dataclass, and a line break."""
    return json.dumps(asdict(record)) + "\n"


def parsed(kind: type[Record], text: str, is_one: Callable[[Mapping[str, Any]], bool], called: str) -> Record:
    """The record of such a line; lists become tuples.

    Args:
        kind: the dataclass.
        text: the line.
        is_one: whether an object of JSON can be such a record.
        called: what such a record is called, for the message.

    Raises:
        ValueError: it is none.
    """
    raw = json.loads(text)
    if not isinstance(raw, dict) or not is_one(raw):
        raise ValueError(f"no {called}")
    known = {entry.name for entry in fields(kind)}  # type: ignore[arg-type]
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in raw.items() if key in known}
    return kind(**values)
