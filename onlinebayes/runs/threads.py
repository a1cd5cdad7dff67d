"""Torch's number of threads, which is one for the whole process: set for a while, and put back.

Idle OpenMP threads spin before they sleep. Beside MuJoCo's own threads they take the cores from them: refining a
two-link arm on two cores took 46 s with two of torch's threads and 12 s with one.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def torch_threads_kept() -> Iterator[None]:
    """Put torch's number of threads back after the block, or the function that this decorates.

    TorchRL (0.14) sets it where environments of environments begin, and where they are closed.
    """
    before = torch.get_num_threads()
    try:
        yield
    finally:
        if torch.get_num_threads() != before:
            torch.set_num_threads(before)


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Let torch compute with one thread inside the block, or the function that this decorates."""
    with torch_threads_kept():
        torch.set_num_threads(1)
        yield
