"""Values that a command line gives by name, NAME=VALUE: read as the type that the name asks for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from types import NoneType, UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from torch import nn

from onlinebayes.runs import BadInput, nearest

D = TypeVar("D")

WORDS = {"true": True, "false": False}


def assignments(texts: Sequence[str], option: str) -> dict[str, str]:
    """Name -> value, as text.

    Args:
        texts: each ``NAME=VALUE``.
        option: that they were given by.

    Raises:
        BadInput: one has no name or no value, or a name is given twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise BadInput(f"--{option} {text}", f"write --{option} NAME=VALUE")
        if name in found:
            raise BadInput(f"--{option} gives {name} twice: {found[name]} and {value}", "leave one of them out")
        found[name] = value
    return found


def changed(settings: D, texts: Sequence[str]) -> D:
    """Settings with other values, such as ``learning_rate=0.001``, ``widths=64,64``, ``activation=relu``.

    Args:
        settings: a frozen dataclass of numbers, such as ``PPOSettings``.
        texts: each ``NAME=VALUE``.

    Raises:
        BadInput: a name that the settings lack, a value of another type, or one that they refuse.
    """
    names, kind = [field.name for field in fields(settings)], type(settings)  # type: ignore[arg-type]
    hints, values = get_type_hints(kind), {}
    for name, text in assignments(texts, "set").items():
        if name not in names:
            raise BadInput(f"{kind.__name__} has no {name!r}", nearest(name, names))
        values[name] = _parsed(name, text, hints[name])
    return replace(settings, **values)  # type: ignore[type-var]


def _parsed(name: str, text: str, kind: Any) -> Any:
    """The value as a type; ``none`` where there may be none."""
    if get_origin(kind) in (Union, UnionType):
        if text.casefold() == "none" and NoneType in get_args(kind):
            return None
        (kind,) = (each for each in get_args(kind) if each is not NoneType)
    if get_origin(kind) is tuple:
        return _parsed_tuple(name, text, get_args(kind))
    if get_origin(kind) is type:
        return _activation(name, text)
    if kind is bool:
        if text.casefold() not in WORDS:
            raise _unlike(name, text, "true or false")
        return WORDS[text.casefold()]
    try:
        return kind(text)
    except ValueError:
        raise _unlike(name, text, "a whole number" if kind is int else "a number") from None


def _parsed_tuple(name: str, text: str, kinds: tuple[Any, ...]) -> tuple[Any, ...]:
    parts = [part for part in text.strip("()[]").split(",") if part.strip()]
    kinds = (kinds[0],) * len(parts) if kinds[-1] is Ellipsis else kinds
    if len(parts) != len(kinds):
        raise _unlike(name, text, f"{len(kinds)} numbers with a comma between them")
    return tuple(_parsed(name, part.strip(), kind) for part, kind in zip(parts, kinds, strict=True))


def _activation(name: str, text: str) -> type[nn.Module]:
    """A class of ``torch.nn.modules.activation`` by its name, in any case."""
    known = {each.casefold(): getattr(nn.modules.activation, each) for each in nn.modules.activation.__all__}
    if text.casefold() not in known:
        raise BadInput(f"{name} = {text} is no activation of torch.nn", nearest(text.casefold(), known))
    return known[text.casefold()]


def _unlike(name: str, text: str, wanted: str) -> BadInput:
    return BadInput(f"{name} = {text}", f"{name} is {wanted}")
