"""Jobs in processes of their own, each within a time limit: what runs over is ended, and so is what dies.

A process pool of the standard library cannot end one job and go on. Processes are spawned, for MuJoCo and torch hold
threads; they leave Ctrl-C to their parent, which ends them.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

from onlinebayes.runs.side_by_side import CORES

R = TypeVar("R")


@dataclass(frozen=True)
class Failed:
    """A job that gave no answer.

    Args:
        problem: ``out of time``, ``the process died``, or the error in one line.
        seconds: that it took on the clock [s].
    """

    problem: str
    seconds: float


@dataclass(frozen=True)
class _Begun:
    number: int
    process: BaseProcess
    began: float


def spawned(jobs: Iterable[Callable[[], R]], processes: int, limit: float) -> Generator[tuple[int, R | Failed]]:
    """Do all jobs; (which, result) as they come.

    Args:
        jobs: picklable, in the order in which they begin.
        processes: at once.
        limit: seconds on the clock that a job may take, the start of its process included [s].
    """
    context, waiting = multiprocessing.get_context("spawn"), enumerate(jobs)
    busy: dict[Connection, _Begun] = {}
    try:
        while True:
            while len(busy) < processes and (job := next(waiting, None)) is not None:
                pipe, theirs = context.Pipe()
                process = context.Process(target=_do, args=(theirs, job[1]), daemon=True)
                process.start()
                theirs.close()
                busy[pipe] = _Begun(job[0], process, time.monotonic())
            if not busy:
                return
            first = min(one.began for one in busy.values()) + limit
            wait(list(busy), None if first == float("inf") else max(0.0, first - time.monotonic()))
            for pipe, one in list(busy.items()):
                seconds = time.monotonic() - one.began
                if pipe.poll():
                    result = _received(pipe, seconds)
                elif seconds >= limit:
                    result = Failed("out of time", seconds)
                else:
                    continue
                del busy[pipe]
                _end(pipe, one.process)
                yield one.number, result
    finally:
        for pipe, one in busy.items():
            _end(pipe, one.process)


def _received(pipe: Connection, seconds: float) -> Any:
    try:
        result, problem = pipe.recv()
    except (EOFError, ConnectionError):
        return Failed("the process died", seconds)
    return Failed(problem, seconds) if problem else result


def _end(pipe: Connection, process: BaseProcess) -> None:
    process.kill()
    process.join()
    pipe.close()


def _do(pipe: Connection, job: Callable[[], Any]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ[CORES] = "1"  # the other jobs need the other cores
    try:
        answer = job(), ""
    except Exception as error:  # the parent counts it, and goes on
        answer = None, f"{type(error).__name__}: {error}".splitlines()[0]
    pipe.send(answer)
