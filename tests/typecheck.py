"""The run-time type checker of the tests: beartype, with an int accepted where a float is asked for (PEP 484).

A fit calls the same small functions a hundred thousand times, and checking every call took over a third of the suite's
time. Checked are, in each test, a function's first calls and some of those that follow. What is never called is not
prepared for being checked either.

``Self`` passes unchecked: functions are decorated one by one, where beartype cannot know the class.
"""

from collections.abc import Callable
from itertools import count
from typing import Any, Self

from beartype import BeartypeConf, FrozenDict, beartype

FIRST = 3
"""Calls of a function that are checked in each test."""
EVERY = 100
"""Of those that follow, one in so many is."""

_decorate = beartype(conf=BeartypeConf(is_pep484_tower=True, hint_overrides=FrozenDict({Self: Any})))
_tests = count(1)
_running = 0


def begin_test() -> None:
    """The counts begin anew."""
    global _running
    _running = next(_tests)


def check(function: Callable[..., Any]) -> Callable[..., Any]:
    """The checker of an empty function with the signature of a real one, as jaxtyping asks for it."""
    checked: Callable[..., Any] | None = None
    test = calls = 0

    def checker(*args: Any, **kwargs: Any) -> Any:
        nonlocal checked, test, calls
        if test != _running:
            test, calls = _running, 0
        calls += 1
        if calls > FIRST and calls % EVERY:
            return None
        if checked is None:
            checked = _decorate(function)
        return checked(*args, **kwargs)

    return checker
