"""A run in a folder of its own: begun or gone on with, told step by step, saved, and left for others to read.

| file               | what it holds                                                  |
|--------------------|----------------------------------------------------------------|
| ``run.json``       | recipe, settings of the run and of its objective               |
| ``checkpoint-*``   | all that the run needs to go on                                |
| ``log.csv``        | one row a step: frames, seconds, losses, belief, figures       |
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol, runtime_checkable

from onlinebayes.inference import Belief
from onlinebayes.runs import RunFolder, write_atomic
from onlinebayes.trainers.checkpoint import Saver, fresh_episodes
from onlinebayes.trainers.growing import GrowingTrainer
from onlinebayes.trainers.online import OnlineTrainer
from onlinebayes.trainers.state import OnlineState, Record

Judge = Callable[[OnlineState], Mapping[str, float]]
"""Judgement after a step by somebody who knows the truth, or has the real system at hand: figures by name."""

Say = Callable[[str], None]
"""Is told in words."""


@runtime_checkable
class Watcher(Protocol):
    """Is told of every step: a recorder, a plot, a terminal display."""

    def __call__(self, state: OnlineState, /) -> None:
        """Look at the state after a complete step."""


def run_in_folder(
    trainer: OnlineTrainer | GrowingTrainer,
    prior: Belief,
    folder: RunFolder,
    *,
    judge: Judge | None = None,
    watchers: tuple[Watcher, ...] = (),
) -> OnlineState:
    """Begin the folder's run, or go on where it was stopped, and keep it up to date step by step.

    Args:
        trainer: built anew, as when the run began.
        prior: of the run.
        folder: held by this process.
        judge: its figures go into the step's record.
        watchers: told after each step.

    Raises:
        BadInput: the folder's checkpoints do not fit, or cannot be written.
    """
    state = OnlineState.begin(prior)
    saver = Saver(trainer, folder.checkpoints)
    if (told := fresh_episodes(trainer)) is not None:
        print(told, flush=True)
    if saver.resume(state):
        print(f"going on in {folder.folder}: {state.kept()}", flush=True)

    def on_step(state: OnlineState) -> None:
        if judge is not None:
            state.records[-1] = replace(state.records[-1], figures=dict(judge(state)))
        tell(state, folder, watchers)

    return trainer.run(state, on_step=on_step, checkpoint=saver)


def say_aloud(text: str) -> None:
    """On the terminal."""
    print(text, flush=True)


def tell(state: OnlineState, folder: RunFolder, watchers: Sequence[Watcher], say: Say = say_aloud) -> None:
    """Write a complete step into the folder's log, say it, and hand it to the watchers."""
    write_atomic(folder.path("log.csv"), as_csv(state))
    say(line(state))
    for watcher in watchers:
        watcher(state)


def line(state: OnlineState) -> str:
    """The last step, for a terminal."""
    record = state.records[-1]
    figures = "  ".join(f"{name} {value:.4g}" for name, value in record.figures.items())
    known = ", ".join(f"{name} {mean:.4g} ± {sd:.2g}" for name, (mean, sd) in record.belief.items())
    belief = f"  belief: {known}" if known else ""
    notes = "".join(f"\n     {note}" for note in record.notes)
    return f"step {record.step}: {record.frames} frames  {figures}{belief}{notes}"


def as_csv(state: OnlineState) -> str:
    """One row a step; what a step did not have is empty."""
    rows = [_row(record) for record in state.records]
    names = list(dict.fromkeys(name for row in rows for name in row))
    file = io.StringIO()
    writer = csv.DictWriter(file, names, restval="")
    writer.writeheader()
    writer.writerows(rows)
    return file.getvalue()


def _row(record: Record) -> dict[str, Any]:
    row: dict[str, Any] = {"step": record.step, "frames": record.frames, "simulated": record.simulated}
    row |= {f"figure/{name}": value for name, value in record.figures.items()}
    for name, (mean, sd) in record.belief.items():
        row |= {f"belief/{name}/mean": mean, f"belief/{name}/sd": sd}
    row |= {f"loss/{name}": value for name, value in record.losses.items()}
    if record.fit is not None and record.fit.validation:
        row["fit/validation"] = min(record.fit.validation)
    if record.coverage is not None:
        row["fit/coverage"] = record.coverage
    row |= {f"seconds/{name}": round(value, 3) for name, value in record.seconds.items()}
    if record.grown:
        row["grown"] = "; ".join(record.grown)
    return row | {"notes": "; ".join(record.notes)}
