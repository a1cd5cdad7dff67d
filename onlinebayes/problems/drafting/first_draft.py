"""A first problem file from a model and its logs.

Columns are matched by name (:mod:`.matching`), by what is in them where names do not say (:mod:`.log_columns`);
parameters are chosen by what the logs tell apart (:mod:`.freeing`); the last runs are held out. What could
not be matched stands in the file as a comment; with everything matched the file loads as it is.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from onlinebayes.identification import FEWEST_BLOCKS, completed, follow
from onlinebayes.measurements import CommandColumn, Measurement, Signal, SignalColumn, TableReader, TimeColumn
from onlinebayes.measurements.formats import open_source
from onlinebayes.measurements.joining import joined
from onlinebayes.measurements.units import to_si
from onlinebayes.problems.drafting.actuator_inputs import actuator_inputs
from onlinebayes.problems.drafting.amplitudes import by_values
from onlinebayes.problems.drafting.draft_text import mapped, text_of
from onlinebayes.problems.drafting.freeing import free_parameters
from onlinebayes.problems.drafting.log_columns import (
    check_rows,
    clock_of,
    is_numeric,
    is_switch,
    is_unit_of,
    last_one,
    rises,
    run_names,
    shared_columns,
    wrenches_of,
)
from onlinebayes.problems.drafting.matching import Match, could_be
from onlinebayes.problems.drafting.proposals import proposals, switches
from onlinebayes.problems.drafting.surroundings import no_actuator, unmeasured_bodies, without_free
from onlinebayes.problems.model import signal_units
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco.sensors import measured_sensors

LIKE_THE_MODEL = ("ctrl.", "enable.", "qpos.", "qvel.", "qfrc.", "xfrc.")


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
    """

    text: str
    matches: tuple[Match, ...]
    missing: Mapping[str, tuple[str, ...]]
    follows: tuple[str, ...]
    unused: tuple[str, ...]
    fixed: Mapping[str, str]
    questions: tuple[str, ...]


def draft(model: Path, logs: Sequence[Path], target: Path) -> Draft:
    """The problem file for a model and its logs, to stand at ``target``."""
    if not model.is_file():
        raise BadInput("no such file", "name the MJCF file of the model", where=str(model))
    simulator = MujocoSimulator(model, threads=1)
    sources = [open_source(log) for log in logs]
    clock = clock_of(sources, shared_columns(sources))
    if clock is not None:
        sources = joined(sources, TimeColumn(clock.column, to_si(clock.unit or "s")))
    shared = shared_columns(sources)
    wanted = (*simulator.signals, *(f"ctrl.{name}" for name in simulator.commands))
    column = "" if clock is None else clock.column
    own = (
        *measured_sensors(simulator.model, shared),
        *(f"enable.{name}" for name in simulator.commands),
        *wrenches_of(simulator, shared),
    )
    told = actuator_inputs(simulator.model)
    matches = proposals(wanted, [name for name in shared if name not in ("run", column)], told)
    units = signal_units(simulator)

    def fits(found: Match) -> bool:
        return is_unit_of(found.unit, units.get(found.name, ""))

    matches = tuple(filter(fits, matches))
    rest = [name for name in shared if name not in {"run", column, *(found.column for found in matches)}]
    switched = [one for one in switches(simulator.commands, rest) if is_switch(sources, one.column)]
    if clock is None and not matches:
        raise BadInput(
            "no column is one of the model's, and none a clock",
            f"the model has {_few(wanted)}; the log has {_few(shared)}; write a problem file that maps them: "
            f'[time] column = "...", [signals."{(*simulator.signals, "qpos.joint")[0]}"] column = "..."',
            where=", ".join(map(str, logs)),
        )
    have = {found.name for found in matches}
    seen = have | {name.replace("qvel.", "qpos.", 1) for name in have if name.startswith("qvel.")}
    needed = [name for name in wanted if not name.startswith("qvel.") and name not in seen]
    follows = follow(simulator, have) & {*needed}
    taken = {"run", column, *own, *(found.column for found in (*matches, *switched))}
    left = [name for name in shared if name not in taken and not name.startswith(LIKE_THE_MODEL)]
    numbers = [name for name in left if needed and is_numeric(sources, name)]
    lacking = {name: could_be(name, wanted, numbers, told) for name in needed if name not in follows}
    if (guess := last_one(lacking)) and fits(guess):
        matches, lacking, taken = (*matches, guess), {}, taken | {guess.column}
    read = by_values(simulator.model, bool(simulator.spec.compiler.degree), matches, units, told, sources, clock)
    matches = (*read.matches, *switched)
    clocks = () if clock else tuple(name for name in shared if name not in taken and rises(sources, name))
    fixed = unmeasured_bodies(simulator.model, lacking)
    missing = ({} if clock else {"time": clocks}) | without_free(lacking, fixed)
    unused = tuple(dict.fromkeys(name for source in sources for name in source.names if name not in taken))
    measurement = _measurement(simulator, logs, clock, matches, unused) if clock and not missing and not fixed else None
    if measurement is None:
        check_rows(sources, matches, column)
    bare = no_actuator(simulator, model, unused)
    questions = (*((bare,) if bare else ()), *read.questions)
    runs = run_names(sources)
    parameters = free_parameters(simulator, measurement and completed(simulator, measurement)[0])
    found = matches if clock is None or clock.exact else (clock, *matches)
    content: dict[str, object] = {
        "schema": 1,
        "model": _relative(model, target),
        "measurements": [_relative(log, target) for log in logs],
        **_runs_and_columns(runs, unused if simulator.model.nu else [name for name in unused if name[:5] != "ctrl."]),
        "parameters": {name: [bounds.low, bounds.high] for name, bounds in parameters.items()},
        **({"time": {"column": clock.column, "unit": clock.unit}} if clock and not clock.exact else {}),
        **mapped(matches, units),
    }
    text = text_of(content, simulator, parameters, found, missing, fixed, questions, target.name)
    return Draft(text, found, missing, tuple(name for name in needed if name in follows), unused, fixed, questions)


def _runs_and_columns(runs: Sequence[str], unused: Sequence[str]) -> dict[str, list[str]]:
    """The runs held out, and columns that look like the model's and are not."""
    held = {"holdout": list(runs[-_held_out(len(runs)) :])} if len(runs) > 1 else {}
    ignored = [name for name in unused if name.startswith(LIKE_THE_MODEL)]
    return held | ({"ignore": ignored} if ignored else {})


def _held_out(runs: int) -> int:
    """Return the number of last runs held out: a third, or fewer that leave enough to be blocks of their own."""
    third = max(1, runs // 3)
    return min(third, runs - FEWEST_BLOCKS) if runs > FEWEST_BLOCKS else third


def _few(names: Sequence[str], most: int = 6) -> str:
    """The first of some names, and how many more there are."""
    shown = ", ".join(f"'{name[:40]}'" for name in names[:most])
    return shown + (f" and {len(names) - most} more" if len(names) > most else "") or "nothing"


def _measurement(
    simulator: MujocoSimulator, logs: Sequence[Path], clock: Match, matches: Sequence[Match], unused: Sequence[str]
) -> Measurement:
    """The logs as the problem file will read them."""
    units = signal_units(simulator)
    signalled = [
        SignalColumn(Signal(found.name, units.get(found.name, "")), found.column, *_line(found))
        for found in matches
        if not found.name.startswith(("ctrl.", "enable."))
    ]
    switched = {one.name.removeprefix("enable."): one.column for one in matches if one.name.startswith("enable.")}
    told = {one.name.removeprefix("ctrl."): one for one in matches if one.name.startswith("ctrl.")}
    commanded = [
        CommandColumn(name, one.column, *_line(one), enable=switched.get(name, "")) for name, one in told.items()
    ]
    time = TimeColumn(clock.column, to_si(clock.unit or "s"))
    signals = [Signal(name) for name in simulator.signals]
    ignore = (*unused, "xfrc.*")  # what pushed is the problem file's to add to the model
    return TableReader(signals, simulator.commands, signalled, commanded, time, ignore).read(logs)


def _line(found: Match) -> tuple[float, float]:
    """Scale and offset of a column."""
    return found.scale * (to_si(found.unit) if found.unit else 1.0), found.offset


def _relative(path: Path, target: Path) -> str:
    return Path(os.path.relpath(path.resolve(), target.resolve().parent)).as_posix()
