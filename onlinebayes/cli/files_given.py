"""Which of the files of a command line is what: one problem file, or a model and its logs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

MODELS = (".xml", ".mjcf", ".urdf")
"""Endings of a model's file."""


def model_and_logs(files: Sequence[str]) -> tuple[str, list[str]]:
    """Return the problem file and no log, or the model and its logs, of one file at least.

    Raises:
        ValueError: neither of the two; says how they are given.
    """
    first, *rest = files
    if Path(first).suffix.lower() in MODELS:
        if not rest:
            raise ValueError(f"a model needs a log: give {first} LOG, or a problem file")
        return first, rest
    if rest:
        raise ValueError(
            f"{' '.join(files)}: give one problem file, or a model ({', '.join(MODELS)}) and then its logs"
        )
    return first, []
