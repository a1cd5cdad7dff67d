"""The possible meanings of the columns of logs, by their values: the clock, numbers, runs, the one that is left."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from onlinebayes.measurements.formats import Source
from onlinebayes.measurements.units import to_si
from onlinebayes.problems.drafting.column_units import unit_of
from onlinebayes.problems.drafting.matching import Match, match_time
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco.wrenches import is_wrench, with_wrenches

LONGEST_STEP = {"s": 1.0, "ms": 1e3, "us": 1e6}
"""Units of a clock, each with the step of a log of one row a second."""


def shared_columns(sources: Sequence[Source]) -> list[str]:
    """The columns that every log has."""
    return [name for name in sources[0].names if all(name in other.names for other in sources)]


def run_names(sources: Sequence[Source]) -> list[str]:
    """Names of the runs, in order."""
    found: list[str] = []
    for source in sources:
        named = "run" in source.names
        found += [str(run) for run in source.columns(["run"], ["run"])["run"]] if named else [source.path.stem]
    return list(dict.fromkeys(found))


def clock_of(sources: Sequence[Source], shared: Sequence[str]) -> Match | None:
    """The clock's column; where its name has no unit, the one in which a log has between 1 and 1000 rows a second."""
    clock = match_time(shared)
    if clock is None or clock.unit:
        return clock
    ticks = sources[0].columns([clock.column])[clock.column]
    step = float(np.median(np.abs(np.diff(ticks)))) if len(ticks) > 1 else 1.0
    unit = next((unit for unit, longest in LONGEST_STEP.items() if step <= longest), "ns")
    return clock if clock.exact and unit == "s" else replace(clock, unit=unit)


def rises(sources: Sequence[Source], column: str) -> bool:
    """Check whether a column could be a clock: numbers that rise from row to row, but where a run begins."""
    try:
        steps = [np.diff(source.columns([column])[column]) for source in sources]
    except BadInput:
        return False
    return all(len(step) > 0 and float(np.mean(step > 0)) > 0.9 for step in steps)


def is_unit_of(unit: str, wanted: str) -> bool:
    """Check whether a column's unit is one of the quantity with this SI unit; no unit is that one itself."""
    try:
        return not unit or to_si(unit, wanted) > 0
    except BadInput:
        return False


def is_numeric(sources: Sequence[Source], column: str) -> bool:
    """Check whether every log has numbers in a column."""
    try:
        return all(np.isfinite(source.columns([column])[column]).any() for source in sources)
    except BadInput:
        return False


def is_switch(sources: Sequence[Source], column: str) -> bool:
    """Check whether every log has 0 or 1 in a column, and nothing else."""
    try:
        cells = np.concatenate([source.columns([column])[column] for source in sources])
    except BadInput:
        return False
    return bool(np.isin(cells[np.isfinite(cells)], (0.0, 1.0)).all())


def last_one(lacking: Mapping[str, tuple[str, ...]]) -> Match | None:
    """The one column left for the one actuator or joint left, where nothing else of the model lacks one."""
    (name, columns), *others = lacking.items() or [("", ())]
    if others or len(columns) != 1 or not name.startswith(("ctrl.", "qpos.")):
        return None
    unit = unit_of("qpos", columns[0]) if name.startswith("qpos.") else ""
    return Match(name, columns[0], unit, "a guess, no other column is left")


def wrenches_of(simulator: MujocoSimulator, columns: Sequence[str]) -> list[str]:
    """The columns of wrenches from outside that act on bodies of the model."""
    found = []
    for column in filter(is_wrench, columns):
        with contextlib.suppress(BadInput):
            with_wrenches(simulator.spec, [column])
            found.append(column)
    return found


def check_rows(sources: Sequence[Source], matches: Sequence[Match], clock: str) -> None:
    """Meet what is wrong with the rows of logs that cannot be read as a whole yet."""
    commands = [found.column for found in matches if found.name.startswith("ctrl.")]
    numbers = {clock, *(found.column for found in matches)} - {""}
    for source in sources:
        text = [name for name in ("run",) if name in source.names]
        source.columns(sorted(numbers | {*text}), text, commands)
