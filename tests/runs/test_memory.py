"""Freed memory goes back to the operating system."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from onlinebayes.runs import give_back_freed_memory


@pytest.mark.skipif(sys.platform != "linux", reason="asks the C library of Linux")
def test_memory_that_was_freed_in_small_pieces_is_no_longer_held() -> None:
    pieces = [np.ones(8_000) for _ in range(2_000)]  # 64 kB each: none is mapped by itself
    kept = [np.ones(8_000)]  # the top of the heap stays in use, so that nothing is returned by itself
    full = resident()
    del pieces
    give_back_freed_memory()
    assert full - resident() > 100 * 2**20
    del kept


def resident() -> int:
    """Bytes of this process in memory."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * 4096
