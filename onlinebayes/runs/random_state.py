"""All random numbers that a run may draw: Python's, NumPy's, torch's on every device; as plain values, and back."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch

from onlinebayes.runs.seeds import seed_everything


def random_state() -> dict[str, Any]:
    """Return the state of every global random generator."""
    version, words, gauss = random.getstate()
    name, keys, position, has_gauss, cached = np.random.get_state(legacy=True)
    return {
        "python": [version, list(words), gauss],
        "numpy": [str(name), torch.from_numpy(np.asarray(keys).astype(np.int64)), position, has_gauss, cached],
        "torch": torch.get_rng_state(),
        "cuda": torch.cuda.get_rng_state_all() if torch.cuda.is_available() else [],
    }


def set_random_state(state: Mapping[str, Any]) -> None:
    """Draw on from where :func:`random_state` was taken; devices that are not here are left out."""
    version, words, gauss = state["python"]
    random.setstate((version, tuple(words), gauss))
    name, keys, position, has_gauss, cached = state["numpy"]
    np.random.set_state((name, keys.cpu().numpy().astype(np.uint32), position, has_gauss, cached))
    torch.set_rng_state(state["torch"].cpu())
    if torch.cuda.is_available() and len(state["cuda"]) == torch.cuda.device_count():
        torch.cuda.set_rng_state_all([device.cpu() for device in state["cuda"]])


class OwnRandom:
    """Random numbers of its own: within :meth:`own` every global generator goes on from where this one stood.

    Args:
        seed: of its numbers.

    Attributes:
        state: where it stands, as :func:`random_state` says it.
    """

    def __init__(self, seed: int) -> None:
        outside = random_state()
        seed_everything(seed)
        self.state = random_state()
        set_random_state(outside)

    @contextmanager
    def own(self) -> Iterator[None]:
        """A block that draws from here and leaves what is drawn outside as it was."""
        outside = random_state()
        set_random_state(self.state)
        try:
            yield
        finally:
            self.state = random_state()
            set_random_state(outside)
