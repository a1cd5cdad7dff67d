"""The end of a script as a command: its exit status, and its lines on bad input and on Ctrl-C.

| exit status | what happened                                                        |
|-------------|----------------------------------------------------------------------|
| 0           | it did what it promises                                              |
| 1           | it ran, and a goal was missed; a run with ``--short`` judges none    |
| 2           | bad input; one line on standard error says which and how to mend it  |
| 130         | it was stopped by Ctrl-C or SIGTERM, after cleaning up               |
"""

from __future__ import annotations

import logging
import signal
import sys
from collections.abc import Callable
from typing import TypeVar

import torch
import tyro

from onlinebayes.experiments.options import Options
from onlinebayes.runs import BadInput

S = TypeVar("S")

MISSED, STOPPED = 1, 130

SHORT = "a short run: it shows that the pieces connect, and judges nothing; without --short it learns"


def settle() -> None:
    """One thread a run, and no chatter of the libraries."""
    torch.set_num_threads(1)
    logging.getLogger("torchrl").setLevel(logging.WARNING)


def status(play: Callable[[S], int | None], settings: type[S], description: str | None) -> int:
    """Exit status of a script.

    Args:
        play: what it does with its settings; None is success, and so is a missed goal of a short run.
        settings: a dataclass, read from the command line.
        description: shown by ``--help``.
    """
    return ended(lambda: _played(play, tyro.cli(settings, description=description)))


def _played(play: Callable[[S], int | None], settings: S) -> int | None:
    short = isinstance(settings, Options) and settings.short
    if short:
        print(SHORT, flush=True)
    code = play(settings)
    return 0 if short and code == MISSED else code


def ended(work: Callable[[], int | None]) -> int:
    """Exit status of some work with settings that are known; None is success."""
    settle()
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return work() or 0
    except BadInput as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return STOPPED
    finally:
        signal.signal(signal.SIGTERM, before)
