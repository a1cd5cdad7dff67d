"""The possible meanings of the columns of logs, by their values: numbers, runs, the one that is left."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence

import numpy as np

from onlinebayes.measurements.formats import Source
from onlinebayes.measurements.units import to_si
from onlinebayes.problems.drafting.column_units import unit_of
from onlinebayes.problems.drafting.matching import Match
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco.wrenches import is_wrench, with_wrenches


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


def check_rows(sources: Sequence[Source], matches: Sequence[Match]) -> None:
    """Meet what is wrong with the rows of logs that cannot be read as a whole yet."""
    commands = [found.column for found in matches if found.name.startswith("ctrl.")]
    numbers = {found.column for found in matches}
    for source in sources:
        text = [name for name in ("run",) if name in source.names]
        source.columns(sorted(numbers | {*text}), text, commands)
