"""Conformance checks for workers, for the tests of one's own: ``check_workers(OnRay(2))``."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from onlinebayes.runs import BadInput
from onlinebayes.trainers.distributed.workers import Workers


def check_workers(workers: Workers) -> None:
    """Jobs are all done and bear their numbers, errors arrive as they were raised, stationed objects remember.

    Raises:
        AssertionError: one of these does not hold.
    """
    assert isinstance(workers, Workers)
    assert workers.number >= 1
    jobs = list(range(2 * workers.number + 1))
    assert sorted(workers.work(_square, jobs)) == [(i, i * i) for i in jobs]
    assert list(workers.work(_square, [])) == []
    assert _refused(lambda: list(workers.work(_refuse, [1]))) == "1 is refused; give another"
    first = next(iter(workers.work(_square, jobs)))
    assert first[1] == first[0] ** 2, "a caller may stop listening"
    ask = workers.station([partial(_counting, 10), partial(_counting, 20)])
    assert ask([1, 2]) == [11, 22]
    assert ask([1, 2]) == [12, 24]
    assert _refused(lambda: ask([-1, 0])) == "-1 is refused; give another"
    assert ask([1, 1]) == [13, 25], "an error ends nothing"


def _refused(act: Callable[[], object]) -> str:
    """Return the message of the :class:`BadInput` that a call raises; empty if none."""
    try:
        act()
    except BadInput as error:
        return str(error)
    return ""


def _square(number: int) -> int:
    return number * number


def _refuse(number: int) -> None:
    raise BadInput(f"{number} is refused", "give another")


def _counting(total: int) -> Callable[[int], int]:
    """An object that adds up what it is told."""

    def add(number: int) -> int:
        nonlocal total
        if number < 0:
            _refuse(number)
        total += number
        return total

    return add
