"""Scalars for those who look at runs with other tools, by TorchRL's own loggers."""

from __future__ import annotations

import sys
from collections.abc import Callable
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path

from torchrl.record.loggers import Logger
from torchrl.record.loggers.tensorboard import TensorboardLogger
from torchrl.record.loggers.wandb import WandbLogger

from onlinebayes.runs import BadInput

Loggers = Callable[[Path], list[Logger]]
"""Folder of a run -> what is told its scalars."""


def tensorboard(folder: str | Path) -> list[Logger]:
    """TorchRL's logger that writes ``folder/tensorboard``; none, and a line that says so, without the package."""
    if find_spec("tensorboard") is None:
        print("no tensorboard/ is written: pip install 'onlinebayes[tensorboard]' for it", file=sys.stderr)
        return []
    return [TensorboardLogger("tensorboard", str(folder))]


def loggers_of(kind: str) -> Loggers:
    """The maker of the loggers of a kind, ``"tensorboard"`` or ``"wandb"``.

    Raises:
        BadInput: another kind, or wandb is asked for and not installed.
    """
    if kind == "tensorboard":
        return tensorboard
    if kind != "wandb":
        raise BadInput(f"no logger is called {kind!r}", "known: tensorboard, wandb")
    if find_spec("wandb") is None:
        raise BadInput("the package wandb is not installed", "pip install 'onlinebayes[wandb]'")
    return _wandb


def _wandb(folder: str | Path) -> list[Logger]:
    """A run of the folder's name at Weights & Biases, which goes on where the folder's run does.

    Where it goes, and whether over the network, say wandb's own variables: ``WANDB_MODE``, ``WANDB_PROJECT``.
    """
    place = Path(folder).resolve()
    mark = sha256(str(place).encode()).hexdigest()[:16]  # runs of one name in two places are two runs
    return [WandbLogger(place.name, save_dir=folder, id=mark, log_env_packages=False, reinit="create_new")]
