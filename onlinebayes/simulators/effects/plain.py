"""An effect as plain values, for a checkpoint: its name, its target, and the bounds of its parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from typing import Any

from onlinebayes.parameters import Parameter
from onlinebayes.runs import BadInput, nearest
from onlinebayes.simulators.effects.base import Effect


def to_plain(effect: Effect) -> dict[str, Any]:
    """Name and fields."""
    if not is_dataclass(effect):
        raise TypeError(f"{type(effect).__name__} is no dataclass: its fields cannot be told")
    return {"name": effect.name, **asdict(effect)}


def from_plain(values: Mapping[str, Any], vocabulary: Mapping[str, type[Effect]]) -> Effect:
    """The effect that :func:`to_plain` wrote down.

    Args:
        values: what it gave.
        vocabulary: name -> kind of every effect that may be meant.

    Raises:
        BadInput: the name is unknown.
    """
    fields = dict(values)
    name = fields.pop("name")
    if name not in vocabulary:
        raise BadInput(f"effect '{name}' is unknown", nearest(name, vocabulary))
    return vocabulary[name](**{field: _value(value) for field, value in fields.items()})


def _value(value: Any) -> Any:
    if isinstance(value, Mapping):
        return Parameter(**value)
    return tuple(value) if isinstance(value, list) else value
