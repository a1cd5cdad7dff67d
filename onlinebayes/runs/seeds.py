"""Seeds: one integer makes a run repeatable, and independent parts get independent streams."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import random
import sys

import numpy as np
import torch

_IMPORTED_IN = os.getpid()


def seed_everything(seed: int) -> None:
    """Seed Python's, NumPy's and PyTorch's global generators, which third-party code draws from."""
    random.seed(seed)
    np.random.seed(seed % 2**32)
    torch.manual_seed(seed)


def worker_seed() -> int | None:
    """A seed of this worker process's own; None in any other process, and in a spawned one that has seeded itself.

    A forked process goes on with its parent's generators, and all spawned ones begin with the same: their workers would
    draw the same numbers. The seed is made of the next global number and of the process's name, which
    :mod:`multiprocessing` counts: it repeats with them. The global generators
    give that one number and are not seeded.
    """
    if multiprocessing.parent_process() is None or _seeded_itself():
        return None
    return seed_of(int(torch.randint(2**62, ())), multiprocessing.current_process().name)


def _seeded_itself() -> bool:
    """True in a spawned process whose seed is no longer PyTorch's own; a forked one may have it from its parent."""
    spawned = os.getpid() == _IMPORTED_IN and "--multiprocessing-fork" in sys.orig_argv
    return spawned and torch.initial_seed() != torch.Generator().initial_seed()


def generator(seed: int, purpose: str = "", device: torch.device | str = "cpu") -> torch.Generator:
    """A generator of its own for one ``purpose`` of a run.

    Args:
        seed: the run's seed.
        purpose: any name, e.g. ``"sensor noise"``; different names give independent streams of the same seed.
        device: where the generator draws.
    """
    return torch.Generator(device=device).manual_seed(_digested(seed, purpose, 7))


def seed_of(seed: int, purpose: str) -> int:
    """A seed below 2^32 for one ``purpose`` of a run; see :func:`generator`."""
    return _digested(seed, purpose, 4)


def _digested(seed: int, purpose: str, size: int) -> int:
    return int.from_bytes(hashlib.sha256(f"{seed}:{purpose}".encode()).digest()[:size], "little")
