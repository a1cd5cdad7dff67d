"""Seeds: one integer makes a run repeatable, and independent parts get independent streams."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import random

import numpy as np
import torch

_LEFT = set[int]()
"""Processes that have left their parent's random numbers."""


def seed_everything(seed: int) -> None:
    """Seed Python's, NumPy's and PyTorch's global generators, which third-party code draws from."""
    random.seed(seed)
    np.random.seed(seed % 2**32)
    torch.manual_seed(seed)


def leave_inherited_numbers() -> None:
    """Give a worker process global random numbers of its own, once; elsewhere do nothing.

    A forked process goes on with its parent's generators, so that all workers draw the same. The new seed is made of
    the next number of those and of the process's name, which :mod:`multiprocessing` counts: it repeats with them.
    """
    if multiprocessing.parent_process() is None or os.getpid() in _LEFT:
        return
    inherited = int(torch.randint(2**62, ()))
    seed_everything(seed_of(inherited, multiprocessing.current_process().name))
    _LEFT.add(os.getpid())


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
