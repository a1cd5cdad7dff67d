"""One thread for torch while somebody else's threads do the work.

Idle OpenMP threads spin before they sleep. Beside MuJoCo's own threads they take the cores from them: refining a
two-link arm on two cores took 46 s with two of torch's threads and 12 s with one.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Let torch compute with one thread inside the block, or the function that this decorates."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
