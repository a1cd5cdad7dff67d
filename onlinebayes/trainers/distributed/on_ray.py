"""Work on Ray: workers of this machine, or of a cluster. A worker that dies loses nothing.

Each worker is an actor. Ray starts another in the place of one that died (``max_restarts``) and gives it the same piece
of work again (``max_task_retries``); a stationed object that was lost is made anew there.

TorchRL's ``RayCollector`` (0.14) is not used. It ends with ``ActorDiedError`` where one of its workers dies; with
restarts a worker comes back with the first policy and the first distribution of theta, and the process group that
sends weights is broken ("Connection closed by peer"); ``total_frames=-1``, data without end, gives none. What runs in
each worker is TorchRL's own ``Collector``.

Importing this does not import Ray. Nothing is started before the first piece of work.
"""

from __future__ import annotations

import importlib.util
import itertools
import logging
import os
import weakref
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeVar

import torch

from onlinebayes.runs import BadInput, heed, one_line
from onlinebayes.trainers.distributed.workers import Station

J = TypeVar("J")
R = TypeVar("R")

PATIENCE = 0.5
"""Between two looks whether the work is to end, while workers are at it [s]."""


class OnRay:
    """Workers on Ray.

    A cluster that is running already is used: one that this process has joined, or that of the environment variable
    ``RAY_ADDRESS``. Else one is started on this machine, and ended by :meth:`close` or with this process.

    Args:
        number: of workers.
        cpus: that Ray sets aside for each, and threads of torch there.
        retries: of a piece of work, for one that always kills its worker must not go on for ever. A death may cost two
            of them: Ray counts its attempts to reach a worker that is gone.

    Raises:
        BadInput: fewer than one worker or CPU, or Ray is not installed.
    """

    def __init__(self, number: int, *, cpus: int = 1, retries: int = 4) -> None:
        if number < 1 or cpus < 1:
            raise BadInput(f"{number} Ray workers of {cpus} CPUs", "give at least one of each")
        if importlib.util.find_spec("ray") is None:
            raise BadInput("Ray is not installed", "pip install 'onlinebayes[ray]'")
        self.number, self.cpus, self.retries = number, cpus, retries
        self._started = False
        self._actors: list[Any] = []
        self._names = itertools.count()

    def work(self, do: Callable[[J], R], jobs: Iterable[J]) -> Iterator[tuple[int, R]]:
        """A job at a time for each worker; those that are at one when the caller stops listening are ended."""
        ray, waiting = self._ray(), enumerate(jobs)
        told, running = ray.put(do), dict[Any, tuple[int, int]]()
        free = list(range(self.number))
        try:
            while True:
                while free and (item := next(waiting, None)) is not None:
                    worker = free.pop()
                    running[self._actor(worker).do.remote(told, item[1])] = (item[0], worker)
                if not running:
                    return
                ready = _awaited(tuple(running))
                answer = self._answer(ready)
                i, worker = running.pop(ready)
                free.append(worker)
                yield i, answer
        finally:
            for reference, (_, worker) in running.items():
                if ray.is_initialized() and not ray.wait([reference], timeout=0)[0]:
                    self._end(worker)

    def station(self, makes: Sequence[Callable[[], Callable[[Any], Any]]]) -> Station:
        """The objects divided among the workers; they go when the answer to this is no longer held."""
        ray = self._ray()
        made = [(next(self._names), [ray.put(make)]) for make in makes]

        def ask(questions: Sequence[Any]) -> list[Any]:
            told = [
                self._actor(i % self.number).ask.remote(name, make, question)
                for i, ((name, make), question) in enumerate(zip(made, questions, strict=True))
            ]
            return [self._answer(reference) for reference in told]

        weakref.finalize(ask, self._forget, [name for name, _ in made]).atexit = False
        return ask

    def close(self) -> None:
        """End the workers, and the cluster if it was started here."""
        for worker in range(len(self._actors)):
            self._end(worker)
        if self._started:
            import ray

            ray.shutdown()
        self._started, self._actors = False, []

    def _ray(self) -> Any:
        """Ray, with a cluster.

        Raises:
            BadInput: the cluster is too small.
        """
        import ray

        if not ray.is_initialized():
            self._actors = []
            quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.WARNING}
            if not os.environ.get("RAY_ADDRESS"):
                cpus = max(self.number * self.cpus, os.cpu_count() or 1)
                quiet |= {"address": "local", "num_cpus": cpus, "include_dashboard": False}
            ray.init(**quiet)
            self._started = True
        there = ray.cluster_resources().get("CPU", 0)
        if there < self.number * self.cpus:
            told = f"{self.number} Ray workers of {self.cpus} CPUs, and the cluster has {there:g}"
            raise BadInput(told, "ask for fewer, or let more nodes join")
        return ray

    def _actor(self, worker: int) -> Any:
        """The worker of that number; all are begun together, one that was ended is begun anew."""
        if not self._actors:
            self._actors = [None] * self.number
        for i, actor in enumerate(self._actors):
            if actor is None:
                options = {"num_cpus": self.cpus, "max_restarts": -1, "max_task_retries": self.retries}
                self._actors[i] = self._ray().remote(**options)(_Worker).remote(self.cpus)
        return self._actors[worker]

    def _end(self, worker: int) -> None:
        """End a worker, whatever it does."""
        import ray

        if ray.is_initialized() and self._actors[worker] is not None:
            ray.kill(self._actors[worker])
        self._actors[worker] = None

    def _forget(self, names: Sequence[int]) -> None:
        """Let go of stationed objects."""
        import ray

        if ray.is_initialized():
            for actor in self._actors:
                if actor is not None:
                    actor.forget.remote(names)

    def _answer(self, reference: Any) -> Any:
        """Return the result of a worker, or raise the error that it raised.

        Raises:
            Stopped: the block in hand was asked to end.
            BadInput: workers died at it again and again.
        """
        from ray import exceptions, get

        _awaited([reference])
        try:
            return get(reference)
        except exceptions.RayTaskError as error:
            if isinstance(error.cause, Exception):
                raise error.cause from error
            raise
        except exceptions.RayError as error:
            words = str(error).strip().splitlines()
            raise BadInput(
                f"Ray workers died at a piece of work that is tried {self.retries + 1} times: "
                + one_line(" ... ".join(line[:200] for line in (words[0], words[-1]))),
                "look at their memory, at what they can import, and at Ray's logs",
            ) from error


def _awaited(references: Sequence[Any]) -> Any:
    """The first piece of work that is done."""
    from ray import wait

    while True:
        heed()
        ready, _ = wait(list(references), timeout=PATIENCE)
        if ready:
            return ready[0]


class _Worker:
    """An actor: does jobs, and holds objects that answer questions."""

    def __init__(self, threads: int) -> None:
        torch.set_num_threads(threads)
        self._objects: dict[int, Callable[[Any], Any]] = {}

    def do(self, do: Callable[[J], R], job: J) -> R:
        """A job."""
        return do(job)

    def ask(self, name: int, make: list[Any], question: Any) -> Any:
        """The answer of the object of that name, which is made where it is not there."""
        if name not in self._objects:
            from ray import get

            self._objects[name] = get(make[0])()
        return self._objects[name](question)

    def forget(self, names: Sequence[int]) -> None:
        """Let go of these objects."""
        for name in names:
            self._objects.pop(name, None)
