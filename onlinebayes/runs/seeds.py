"""Seeds: one integer makes a run repeatable, and independent parts get independent streams."""

from __future__ import annotations

import hashlib
import random

import numpy as np
import torch


def seed_everything(seed: int) -> None:
    """Seed Python's, NumPy's and PyTorch's global generators, which third-party code draws from."""
    random.seed(seed)
    np.random.seed(seed % 2**32)
    torch.manual_seed(seed)


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
