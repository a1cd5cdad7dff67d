"""A recipe's run as it ended: done first where it is missing, gone on with where it was stopped."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from onlinebayes.experiments import STOPPED, Run, Settings, place_of, recorded_settings, run
from onlinebayes.runs import BadInput, Checkpoints, RunFolder
from onlinebayes.trainers import OnlineState, Saver

S = TypeVar("S", bound=Settings)


def finished_run(name: str, build: Callable[[S], Run], settings: S) -> tuple[Run, OnlineState]:
    """The run with its policy, and what it believes.

    Args:
        name: of the recipe.
        build: the recipe's.
        settings: of the run; its folder lies in ``settings.out``.

    Raises:
        KeyboardInterrupt: it was stopped.
        BadInput: it was made with other settings, or what it had learnt is no longer there.
    """
    folder = place_of(name, settings)
    if not (folder / "finished").exists() and run(name, build, settings) == STOPPED:
        raise KeyboardInterrupt
    with RunFolder(folder, name, settings=recorded_settings(settings)):  # which refuses other settings
        made = build(settings)
        state = OnlineState.begin(made.problem.prior)
        if not Saver(made.trainer, Checkpoints(folder, name)).resume(state):
            raise BadInput(f"{folder} has no checkpoint of its finished run", "delete that folder to do it anew")
    return made, state
