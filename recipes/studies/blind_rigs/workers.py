"""Jobs in processes of their own, each within a time limit: what runs over is ended, and so is what dies.

A process pool of the standard library cannot end one job and go on. Processes are spawned, for MuJoCo and torch hold
threads; they leave Ctrl-C to their parent, which ends them.
"""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnContext
from multiprocessing.process import BaseProcess
from typing import Generic, TypeVar

J = TypeVar("J")
R = TypeVar("R")

READY = "ready"


@dataclass(frozen=True)
class Done(Generic[J, R]):
    """A job that ended: with a result, or with the reason for having none.

    Args:
        job: what was asked.
        result: None where ``problem`` is not empty.
        problem: ``out of time``, ``the process died``, or the error in one line.
        seconds: that it took [s].
    """

    job: J
    result: R | None
    problem: str
    seconds: float


def work(jobs: Iterable[J], do: Callable[[J], R], processes: int, limit: float) -> Iterator[Done[J, R]]:
    """Do all jobs, each in one of ``processes`` processes and for ``limit`` seconds at most; results as they come.

    Args:
        jobs: in the order in which they begin.
        do: picklable.
        processes: one or more.
        limit: seconds a job may take [s]; starting a process does not count.
    """
    context, waiting = multiprocessing.get_context("spawn"), deque(jobs)
    crew = [_Worker[J, R](context, do) for _ in range(min(processes, len(waiting)))]
    try:
        while waiting or any(worker.job is not None for worker in crew):
            for worker in crew:
                if worker.ready and worker.job is None and waiting:
                    worker.begin(waiting.popleft())
            busy = [worker for worker in crew if worker.job is not None or not worker.ready]
            wait([worker.pipe for worker in busy], min((worker.left(limit) for worker in busy), default=0.0))
            for worker in busy:
                if (done := worker.poll(limit)) is not None:
                    yield done
    finally:
        for worker in crew:
            worker.end()


@dataclass
class _Worker(Generic[J, R]):
    """One process and the job that it is at."""

    context: SpawnContext
    do: Callable[[J], R]
    job: J | None = None
    ready: bool = False
    began: float = 0.0
    pipe: Connection = field(init=False)
    process: BaseProcess = field(init=False)

    def __post_init__(self) -> None:
        self._start()

    def _start(self) -> None:
        self.pipe, theirs = self.context.Pipe()
        self.process = self.context.Process(target=_serve, args=(theirs, self.do), daemon=True)
        self.process.start()
        theirs.close()
        self.ready, self.job = False, None

    def begin(self, job: J) -> None:
        """Hand over a job."""
        self.job, self.began = job, time.monotonic()
        self.pipe.send(job)

    def left(self, limit: float) -> float:
        """Seconds until the job is over time [s]; a minute while there is none."""
        return 60.0 if self.job is None else max(0.0, self.began + limit - time.monotonic())

    def poll(self, limit: float) -> Done[J, R] | None:
        """What has become of the job, if anything has."""
        try:
            if self.pipe.poll():
                return self._received(*self.pipe.recv())
            if self.job is not None and self.left(limit) == 0.0:
                return self._gone("out of time")
        except (EOFError, ConnectionError):
            if self.job is None:
                raise RuntimeError("a process died before its first job: see above") from None
            return self._gone("the process died")
        return None

    def _received(self, result: R | None, problem: str) -> Done[J, R] | None:
        if problem == READY:
            self.ready = True
            return None
        assert self.job is not None
        done = Done(self.job, result, problem, time.monotonic() - self.began)
        self.job = None
        return done

    def _gone(self, problem: str) -> Done[J, R]:
        assert self.job is not None
        done: Done[J, R] = Done(self.job, None, problem, time.monotonic() - self.began)
        self.end()
        self._start()
        return done

    def end(self) -> None:
        """End the process whatever it does."""
        self.process.kill()
        self.process.join()
        self.pipe.close()


def _serve(pipe: Connection, do: Callable[[J], R]) -> None:
    """Take jobs and give results until the other end closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    pipe.send((None, READY))
    while True:
        try:
            job = pipe.recv()
        except EOFError:
            return
        answer: tuple[R | None, str]
        try:
            answer = do(job), ""
        except Exception as error:  # the parent counts it, and goes on
            answer = None, f"{type(error).__name__}: {error}".splitlines()[0]
        pipe.send(answer)
