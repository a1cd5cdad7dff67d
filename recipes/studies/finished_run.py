"""A recipe's run as it ended: done first where it is missing, gone on with where it was stopped."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from onlinebayes.runs import BadInput, Checkpoints
from onlinebayes.trainers import OnlineState, Saver
from recipes.common import Run, Settings, folder_of, run

S = TypeVar("S", bound=Settings)


def finished_run(name: str, build: Callable[[S], Run], settings: S) -> tuple[Run, OnlineState]:
    """The run with its policy, and what it believes.

    Args:
        name: of the recipe.
        build: the recipe's.
        settings: of the run; its folder lies in ``settings.out``.

    Raises:
        BadInput: it was stopped.
    """
    folder = Path(settings.out) / folder_of(name, settings)
    if not (folder / "finished").exists():
        run(name, build, settings)
    if not (folder / "finished").exists():
        raise BadInput(f"the run in {folder} was stopped", "the same command goes on from there")
    made = build(settings)
    state = OnlineState.begin(made.problem.prior)
    Saver(made.trainer, Checkpoints(folder, name)).resume(state)
    return made, state
