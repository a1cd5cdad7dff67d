"""The places where work is done: in this process, one piece after the other, or by workers elsewhere.

    for number, result in workers.work(do, jobs): ...        do(job) for each job; results as they come
    ask = workers.station([make_0, make_1, ...])             objects that stay where they are
    answers = ask([question_0, question_1, ...])             one for each object; they may be asked again and again

What is handed over travels by pickle. A worker that dies is replaced and its piece of work done anew: a job has to be
decided by its argument, and a stationed object by its ``make`` and its question, random numbers included. Then nothing
depends on where the work was done, or on how often.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar, runtime_checkable

J = TypeVar("J")
R = TypeVar("R")

Station = Callable[[Sequence[Any]], list[Any]]
"""One question for each stationed object -> their answers in the same order."""


@runtime_checkable
class Workers(Protocol):
    """Whoever does the work; :func:`~onlinebayes.trainers.distributed.check_workers` says what is asked of them."""

    @property
    def number(self) -> int:
        """The number of workers, which is into how many parts work is divided."""

    def work(self, do: Callable[[J], R], jobs: Iterable[J]) -> Iterator[tuple[int, R]]:
        """Do all jobs, each looked up when it is its turn; (number, result) as they come. What one raises is raised."""

    def station(self, makes: Sequence[Callable[[], Callable[[Any], Any]]]) -> Station:
        """Let each ``make`` build an object that stays with a worker and answers questions."""

    def close(self) -> None:
        """End what was begun; work that is still going on is given up."""


@dataclass(frozen=True)
class Here:
    """This process alone; gives what any other workers of the same number give.

    Args:
        number: of parts into which work is divided.
    """

    number: int = 1

    def work(self, do: Callable[[J], R], jobs: Iterable[J]) -> Iterator[tuple[int, R]]:
        """One after the other."""
        for i, job in enumerate(jobs):
            yield i, do(job)

    def station(self, makes: Sequence[Callable[[], Callable[[Any], Any]]]) -> Station:
        """Objects of this process."""
        objects = [make() for make in makes]
        return lambda questions: [each(question) for each, question in zip(objects, questions, strict=True)]

    def close(self) -> None:
        """Nothing was begun."""
