"""Scalars for those who look at runs with other tools, by TorchRL's own loggers."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

from torchrl.record.loggers import Logger
from torchrl.record.loggers.tensorboard import TensorboardLogger


def tensorboard(folder: str | Path) -> list[Logger]:
    """TorchRL's logger that writes ``folder/tensorboard``; none, and a line that says so, without the package."""
    if find_spec("tensorboard") is None:
        print("no tensorboard/ is written: pip install tensorboard for it", file=sys.stderr)
        return []
    return [TensorboardLogger("tensorboard", str(folder))]
