"""A first problem file from a model and its logs.

Columns are matched by name (:mod:`.matching`), by what is in them where names do not say (:mod:`.log_columns`);
parameters are chosen by what the logs tell apart (:mod:`.freeing`); the last runs are held out. What could
not be matched stands in the file as a comment; with everything matched the file loads as it is.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from onlinebayes.identification import FEWEST_BLOCKS, completed, follow
from onlinebayes.measurements import CommandColumn, Measurement, Signal, SignalColumn, TableReader
from onlinebayes.measurements.clocks import TIME
from onlinebayes.measurements.formats import Source, open_source
from onlinebayes.measurements.units import to_si
from onlinebayes.problems.drafting.clocks import Clock, clock_of, rises, timed
from onlinebayes.problems.drafting.draft_text import mapped, text_of
from onlinebayes.problems.drafting.freeing import free_parameters
from onlinebayes.problems.drafting.log_columns import (
    check_rows,
    is_numeric,
    is_unit_of,
    last_one,
    run_names,
    shared_columns,
    wrenches_of,
)
from onlinebayes.problems.drafting.matching import Match, could_be, match
from onlinebayes.problems.drafting.servo_inputs import servo_inputs
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
        untied: clocks that do not overlap, with what to write; nothing when the file is complete.
    """

    text: str
    matches: tuple[Match, ...]
    missing: Mapping[str, tuple[str, ...]]
    follows: tuple[str, ...]
    unused: tuple[str, ...]
    untied: tuple[str, ...] = ()


def draft(model: Path, logs: Sequence[Path], target: Path) -> Draft:
    """The problem file for a model and its logs, to stand at ``target``."""
    if not model.is_file():
        raise BadInput("no such file", "name the MJCF file of the model", where=str(model))
    simulator = MujocoSimulator(model, threads=1)
    sources: Sequence[Source] = [open_source(log) for log in logs]
    found_clocks = [clock_of(source) for source in sources]
    clocks = [clock for clock in found_clocks if clock is not None]
    unclear = [source for source, clock in zip(sources, found_clocks, strict=True) if clock is None]
    untied: list[str] = []
    if not unclear:
        sources, untied = timed(sources, clocks)
    shared = shared_columns(sources)
    wanted = (*simulator.signals, *(f"ctrl.{name}" for name in simulator.commands))
    own = (
        *measured_sensors(simulator.model, shared),
        *(f"enable.{name}" for name in simulator.commands),
        *wrenches_of(simulator, shared),
    )
    told = servo_inputs(simulator.model)
    matches = match(wanted, [name for name in shared if name not in ("run", TIME)], told)
    units = signal_units(simulator)

    def fits(found: Match) -> bool:
        return is_unit_of(found.unit, units.get(found.name, ""))

    matches = tuple(filter(fits, matches))
    if unclear and not matches:
        there = dict.fromkeys(name for source in sources for name in source.names)
        raise BadInput(
            "no column is one of the model's, and none a clock",
            f"the model has {_few(wanted)}; the log has {_few([*there])}; write a problem file that maps them: "
            f'[time] column = "...", [signals."{(*simulator.signals, "qpos.joint")[0]}"] column = "..."',
            where=", ".join(map(str, logs)),
        )
    have = {found.name for found in matches}
    seen = have | {name.replace("qvel.", "qpos.", 1) for name in have if name.startswith("qvel.")}
    needed = [name for name in wanted if not name.startswith("qvel.") and name not in seen]
    follows = follow(simulator, have) & {*needed}
    taken = {"run", TIME, *own, *(found.column for found in matches)}
    left = [name for name in shared if name not in taken and not name.startswith(LIKE_THE_MODEL)]
    numbers = [name for name in left if needed and is_numeric(sources, name)]
    lacking = {name: could_be(name, wanted, numbers, told) for name in needed if name not in follows}
    if (guess := last_one(lacking)) and fits(guess):
        matches, lacking, taken = (*matches, guess), {}, taken | {guess.column}
    missing = ({"time": _rising(unclear, taken)} if unclear else {}) | lacking
    unused = tuple(dict.fromkeys(name for source in sources for name in source.names if name not in taken))
    ready = not (unclear or missing or untied)
    measurement = _measurement(simulator, logs, clocks, matches, unused) if ready else None
    if measurement is None:
        check_rows(sources, matches)
    runs = run_names(sources)
    parameters = free_parameters(simulator, measurement and completed(simulator, measurement)[0])
    told_apart = () if unclear else dict.fromkeys(clock.match for clock in clocks if not clock.exact)
    found = (*told_apart, *matches)
    tables = [_relative(log, target) for log in logs]
    content: dict[str, object] = {
        "schema": 1,
        "model": _relative(model, target),
        "measurements": tables,
        **_runs_and_columns(runs, unused),
        "parameters": {name: [bounds.low, bounds.high] for name, bounds in parameters.items()},
        **({} if unclear else _time(tables, clocks)),
        **mapped(matches),
    }
    text = text_of(content, simulator, parameters, found, missing, target.name, untied)
    return Draft(text, found, missing, tuple(name for name in needed if name in follows), unused, tuple(untied))


def _rising(sources: Sequence[Source], taken: Collection[str]) -> tuple[str, ...]:
    """Columns that could be the clock of logs that have none by name."""
    shared = [name for name in shared_columns(sources) if name not in taken]
    return tuple(name for name in shared if all(rises(source, name) for source in sources))


def _time(tables: Sequence[str], clocks: Sequence[Clock]) -> dict[str, dict[str, Any]]:
    """``[time]``: the first log's clock, and those of logs that have another one."""
    others = {table: clock.table for table, clock in zip(tables, clocks, strict=True) if clock != clocks[0]}
    first = {} if clocks[0].exact else clocks[0].table
    return {"time": first | others} if first or others else {}


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
    simulator: MujocoSimulator,
    logs: Sequence[Path],
    clocks: Sequence[Clock],
    matches: Sequence[Match],
    unused: Sequence[str],
) -> Measurement:
    """The logs as the problem file will read them."""
    units = signal_units(simulator)
    signalled = [
        SignalColumn(
            Signal(found.name, units.get(found.name, "")), found.column, to_si(found.unit) if found.unit else 1.0
        )
        for found in matches
        if not found.name.startswith("ctrl.")
    ]
    commanded = [
        CommandColumn(found.name.removeprefix("ctrl."), found.column, to_si(found.unit) if found.unit else 1.0)
        for found in matches
        if found.name.startswith("ctrl.")
    ]
    columns = [clock.time_column for clock in clocks]
    own = dict(zip(logs, columns, strict=True))
    signals = [Signal(name) for name in simulator.signals]
    ignore = (*unused, "xfrc.*")  # what pushed is the problem file's to add to the model
    reader = TableReader(signals, simulator.commands, signalled, commanded, columns[0], ignore, clocks=own)
    return reader.read(logs)


def _relative(path: Path, target: Path) -> str:
    return Path(os.path.relpath(path.resolve(), target.resolve().parent)).as_posix()
