"""From any device to the host: the engine reads arrays there, and callers may hold masks and commands elsewhere."""

from __future__ import annotations

import numpy as np
from torch import Tensor


def to_host(x: Tensor) -> np.ndarray:
    """The values of a tensor; they share its memory where it is on the host already."""
    return x.detach().cpu().numpy()
