"""A first problem file from a model and its logs.

Every log has its clock (:mod:`.logs`); columns are matched by name, and by what is in them where names do not say
(:mod:`.assignment`); parameters are chosen by what the logs tell apart (:mod:`.freeing`), and runs to be held out by
how they move (:mod:`.holding_out`).
What could not be matched stands in the file as a comment; with everything matched the file loads as it is.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from onlinebayes.identification import completed
from onlinebayes.problems.drafting.assignment import LIKE_THE_MODEL, assign
from onlinebayes.problems.drafting.clocks import Clock
from onlinebayes.problems.drafting.draft_text import mapped, text_of
from onlinebayes.problems.drafting.freeing import free_parameters
from onlinebayes.problems.drafting.holding_out import held_out
from onlinebayes.problems.drafting.idle_parts import idle_bodies
from onlinebayes.problems.drafting.log_columns import check_rows, run_names
from onlinebayes.problems.drafting.logs import measurement_of, open_logs
from onlinebayes.problems.drafting.matching import Match
from onlinebayes.problems.drafting.surroundings import no_actuator
from onlinebayes.problems.model import signal_units
from onlinebayes.problems.welding import weld
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco import MujocoSimulator


@dataclass(frozen=True)
class Draft:
    """A first problem file.

    Args:
        text: of the file.
        matches: columns that were found.
        missing: names of the model without a column, with those that it could be; nothing when the file is complete.
        follows: positions without a column that constraints tie to those that have one.
        unused: columns of the logs that nothing takes.
        fixed: free joints that nobody measured -> their bodies, which may be welded.
        questions: what the values of the logs leave open, in lines.
        untied: clocks that do not overlap, with what to write; nothing when the file is complete.
        idle: bodies that the file welds: nothing shows how they move, or moves them.
    """

    text: str
    matches: tuple[Match, ...]
    missing: Mapping[str, tuple[str, ...]]
    follows: tuple[str, ...]
    unused: tuple[str, ...]
    fixed: Mapping[str, str]
    questions: tuple[str, ...]
    untied: tuple[str, ...] = ()
    idle: tuple[str, ...] = ()


def draft(model: Path, logs: Sequence[Path], target: Path, say: Callable[[str], None] = lambda _line: None) -> Draft:
    """The problem file for a model and its logs, to stand at ``target``; ``say`` is told of the slow part."""
    if not model.is_file():
        raise BadInput("no such file", "name the MJCF file of the model", where=str(model))
    simulator = MujocoSimulator(model, threads=1)
    opened = open_logs(logs)
    made = assign(simulator, opened)
    if idle := idle_bodies(simulator.spec, made.missing):
        simulator = _without(simulator, idle)
        made = assign(simulator, opened)
    ready = opened.timed and not (made.missing or made.fixed or opened.untied)
    measurement = measurement_of(simulator, opened, made.matches, made.unused) if ready else None
    if measurement is None:
        check_rows(opened.sources, made.matches)
    say("asking the logs which parameters they tell apart")
    parameters = free_parameters(simulator, measurement and completed(simulator, measurement)[0])
    tables = [_relative(log, target) for log in logs]
    foreign = made.unused if simulator.model.nu else [name for name in made.unused if not name.startswith("ctrl.")]
    content: dict[str, object] = {
        "schema": 1,
        "model": _relative(model, target),
        "measurements": tables,
        **_runs_and_columns(held_out(run_names(opened.sources), measurement), foreign),
        "parameters": {name: [bounds.low, bounds.high] for name, bounds in parameters.items()},
        **(_time(tables, opened.clocks) if opened.timed else {}),
        **mapped(made.matches, signal_units(simulator)),
        **({"model_edit": {"weld": list(idle)}} if idle else {}),
    }
    named = dict.fromkeys(clock.match for clock in opened.clocks if opened.timed and not clock.exact)
    found = (*named, *made.matches)
    bare = no_actuator(simulator, model, made.unused)
    asked = (*((bare,) if bare else ()), *made.questions)
    text = text_of(content, simulator, parameters, found, made.missing, made.fixed, asked, target.name, opened.untied)
    return Draft(text, found, made.missing, made.follows, made.unused, made.fixed, asked, opened.untied, idle)


def _without(simulator: MujocoSimulator, idle: Sequence[str]) -> MujocoSimulator:
    """The model with some bodies welded."""
    spec = simulator.spec.copy()
    weld(spec, idle)
    return MujocoSimulator(spec, threads=1)


def _time(tables: Sequence[str], clocks: Sequence[Clock]) -> dict[str, dict[str, Any]]:
    """``[time]``: the first log's clock, and those of logs that have another one."""
    others = {table: clock.table for table, clock in zip(tables, clocks, strict=True) if clock != clocks[0]}
    first = {} if clocks[0].exact else clocks[0].table
    return {"time": first | others} if first or others else {}


def _runs_and_columns(held: Sequence[str], unused: Sequence[str]) -> dict[str, list[str]]:
    """The runs held out, and columns that look like the model's and are not."""
    holdout = {"holdout": list(held)} if held else {}
    ignored = [name for name in unused if name.startswith(LIKE_THE_MODEL)]
    return holdout | ({"ignore": ignored} if ignored else {})


def _relative(path: Path, target: Path) -> str:
    return Path(os.path.relpath(path.resolve(), target.resolve().parent)).as_posix()
