"""Independent pieces of work side by side, each on a core of its own, with the answers that one core would give.

    answers = side_by_side([partial(fit, model) for model in models])        as [fit(model) for model in models]

Every process is a copy of this one (``fork``): nothing is sent there, and the answers come back through pipes. A copy
says nothing and writes nothing; it ends with this process's work, not with its own. Where a copy dies, or its answer
cannot be sent, this process does that piece itself. Other systems than Linux, processes that hold a GPU and threads
beside the main one do all of it one by one.

Time is processor time: that of copies that have ended is counted (:func:`processor_time`), so that a budget means the
same on one core and on sixteen.
"""

from __future__ import annotations

import gc
import os
import pickle
import select
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, Pipe
from typing import NoReturn, TypeVar

import torch

from onlinebayes.runs.interrupt import heed

T = TypeVar("T")

CORES = "ONLINEBAYES_CORES"
"""Environment variable: cores that one command may use; all that the system gives this process when unset."""

POLL_S = 0.2
"""Seconds between two looks at whether the work is to end."""


@dataclass
class _Copy:
    """State of a copy: whether it is one, and the processor time that was spent before it began [s]."""

    made: bool = False
    spent_before: float = 0.0


_HERE = _Copy()


def cores() -> int:
    """Cores that this process may use: one in a copy."""
    if _HERE.made:
        return 1
    wanted = os.environ.get(CORES, "")
    if wanted.isdigit() and int(wanted) > 0:
        return int(wanted)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def processor_time() -> float:
    """Processor time of this process and of all copies that have ended; in a copy, of what came before it too [s]."""
    used = os.times()
    return _HERE.spent_before + used.user + used.system + used.children_user + used.children_system


def side_by_side(work: Sequence[Callable[[], T]]) -> list[T]:
    """Run all pieces at once and return their results, in their order.

    Args:
        work: pieces that neither wait for one another nor change what another one reads.

    Raises:
        Stopped: the block in hand was asked to end.
        Exception: what one of the pieces raised.
    """
    count = min(len(work), cores())
    if count < 2 or not _may_fork():
        return [piece() for piece in work]
    workers = [_Worker(range(k, len(work), count)) for k in range(1, count)]
    try:
        for one in workers:
            one.start(work)
        found: dict[int, T] = {k: work[k]() for k in range(0, len(work), count)}
        for one in workers:
            found.update(one.answers(work))
    finally:
        for one in workers:
            one.end()
    return [found[k] for k in range(len(work))]


def _may_fork() -> bool:
    main = threading.current_thread() is threading.main_thread()
    return sys.platform == "linux" and main and not torch.cuda.is_initialized()


@dataclass
class _Worker:
    """A copy of this process, and the pieces that it does."""

    pieces: Sequence[int]
    pid: int = 0
    pipe: Connection = field(init=False)

    def start(self, work: Sequence[Callable[[], T]]) -> None:
        """Begin; nothing where the system gives no more processes."""
        here, there = Pipe(duplex=False)
        self.pipe = here
        before = processor_time()
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)  # threads of MuJoCo and torch stay behind, idle
                self.pid = os.fork()
        except OSError:
            there.close()
            return
        if not self.pid:
            _HERE.made, _HERE.spent_before = True, before
            here.close()
            _serve(there, work, self.pieces)
        there.close()

    def answers(self, work: Sequence[Callable[[], T]]) -> dict[int, T]:
        """Return the results of its pieces; they are done here where it has none."""
        while self.pid and not select.select([self.pipe], [], [], POLL_S)[0]:
            heed()
        try:
            sent = self.pipe.recv_bytes() if self.pid else b""
        except (EOFError, OSError):
            sent = b""
        if not sent:
            return {k: work[k]() for k in self.pieces}
        found: dict[int, T]
        found, error = pickle.loads(sent)
        if error is not None:
            raise error
        return found

    def end(self) -> None:
        """End it, done or not."""
        self.pipe.close()
        if self.pid:
            os.kill(self.pid, signal.SIGKILL)
            os.waitpid(self.pid, 0)
            self.pid = 0


def _serve(pipe: Connection, work: Sequence[Callable[[], T]], pieces: Sequence[int]) -> NoReturn:
    """Run the pieces in a copy: silent, deaf to Ctrl-C, which its parent hears, and gone without a word."""
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        gc.freeze()
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for stream in (1, 2):
            os.dup2(nowhere, stream)
        sys.stdout = sys.stderr = os.fdopen(nowhere, "w")
        pipe.send_bytes(_done(work, pieces))
    finally:
        os._exit(0)


def _done(work: Sequence[Callable[[], T]], pieces: Sequence[int]) -> bytes:
    """Run the pieces and return the message of a copy: the answers, or the first error."""
    found: dict[int, T] = {}
    try:
        for k in pieces:
            found[k] = work[k]()
    except Exception as error:  # whatever it is, it is raised where the answer was asked for
        return pickle.dumps(({}, error))
    return pickle.dumps((found, None))
