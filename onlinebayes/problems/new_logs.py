"""New logs of a refined machine, read as its problem file reads its own, and held against it.

    check_logs("out/refine", ["tonight.csv"])

What the problem file says of runs by name (``holdout``, ``exclude`` ...) is about its own runs and not asked of the new
ones. A run whose name is taken gets that of its log in front.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import torch

from onlinebayes.criticism import Check, check
from onlinebayes.measurements import Measurement, concatenate
from onlinebayes.problems.problem_file import ProblemFile, problem_of, read_toml
from onlinebayes.problems.worlds import load_worlds
from onlinebayes.runs import BadInput, Interrupt, Stages, Watch, users_memo

OF_OWN_RUNS = ("holdout", "exclude", "groups", "units", "runs")
"""Keys that speak of the problem's own runs."""


def check_logs(folder: str | Path, logs: Sequence[str | Path]) -> Check:
    """Hold new logs against the model that ``refine`` wrote to a folder.

    Args:
        folder: that ``refine`` wrote to; the logs that it was refined on are read again.
        logs: tables of the same columns, in the order of time.

    Raises:
        BadInput: the folder or a log cannot be used, or parameters differ between runs.
        Stopped: it was interrupted.
    """
    models = load_worlds(folder)
    problem = models.problems[0]
    if problem.scope:
        raise BadInput(
            "new logs are not held against parameters that differ between runs by this version",
            'leave out [runs], [effects.scope] and scope = "per_run" or "per_unit", and refine again',
            where=str(problem.path),
        )
    new = new_runs(problem, [Path(log) for log in logs])
    space = models.worlds.space
    mine = [space.index(name) for name in problem.simulator.parameters]
    covariance = models.worlds.covariance[0][mine][:, mine]
    stopping = "onlinebayes: stopping; Ctrl-C again ends the step in hand at once"
    with Interrupt(stopping) as interrupt, Stages() as say:
        return check(
            problem.simulator,
            covariance,
            problem.measurement,
            new,
            selection=problem.selection,
            watch=Watch(say, interrupt),
            memo=users_memo(),
        )


def new_runs(problem: ProblemFile, logs: Sequence[Path]) -> Measurement:
    """The runs of new logs, with names of their own.

    Raises:
        BadInput: a log cannot be read, lacks a signal of the reference, or two logs are one.
    """
    content = {key: value for key, value in read_toml(problem.path).items() if key not in OF_OWN_RUNS}
    taken, found = set(problem.measurement.runs), list[Measurement]()
    for log in logs:
        if not log.is_file():
            raise BadInput("no such file", "name a log of the machine", where=str(log))
        read = problem_of({**content, "measurements": [str(log.resolve())]}, problem.path).measurement
        read = _as_measured(read, problem.measurement, log)
        names = [run if run not in taken else f"{log.stem}:{run}" for run in read.runs]
        if repeated := [name for name in names if name in taken]:
            raise BadInput(f"run '{repeated[0]}' stands in two logs", "name each log once", where=str(log))
        taken |= {*names}
        found.append(replace(read, runs=tuple(names)))
    return concatenate(found)


def _as_measured(read: Measurement, reference: Measurement, log: Path) -> Measurement:
    """The log with the signals of the reference."""
    own = [signal.name for signal in read.signals]
    if missing := [signal.name for signal in reference.signals if signal.name not in own]:
        problem = f"has no measured value of {missing[0]}, by which the model was refined"
        raise BadInput(problem, "record it, or refine on logs without it", where=str(log))
    places = torch.tensor([own.index(signal.name) for signal in reference.signals])
    data = read.data.clone(recurse=False)
    data["signal"], data["measured"] = data["signal"][..., places], data["measured"][..., places]
    return replace(read, data=data, signals=reference.signals)
