"""Which column of the logs each of the model's names gets: by its name, by its values, as the last one left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from onlinebayes.identification import follow
from onlinebayes.measurements.clocks import RUN, TIME
from onlinebayes.problems.drafting.actuator_inputs import actuator_inputs
from onlinebayes.problems.drafting.amplitudes import by_values
from onlinebayes.problems.drafting.log_columns import is_numeric, is_switch, is_unit_of, last_one, wrenches_of
from onlinebayes.problems.drafting.logs import Logs
from onlinebayes.problems.drafting.matching import Match, could_be
from onlinebayes.problems.drafting.proposals import proposals, switches
from onlinebayes.problems.drafting.surroundings import unmeasured_bodies, without_free
from onlinebayes.problems.model import signal_units
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco.sensors import measured_sensors

LIKE_THE_MODEL = ("ctrl.", "enable.", "qpos.", "qvel.", "qfrc.", "xfrc.")
"""Columns whose names begin so are of a model: of another one, where this one has no such name."""


@dataclass(frozen=True)
class Assignment:
    """What the columns are.

    Args:
        matches: the columns that were found for the model's names, its switches among them.
        missing: names of the model, or ``time``, without a column, with those that it could be.
        fixed: free joints that nobody measured -> their bodies.
        follows: positions without a column that constraints tie to those that have one.
        unused: columns that nothing takes.
        questions: what the values leave open.
    """

    matches: tuple[Match, ...]
    missing: Mapping[str, tuple[str, ...]]
    fixed: Mapping[str, str]
    follows: tuple[str, ...]
    unused: tuple[str, ...]
    questions: tuple[str, ...]


def assign(simulator: MujocoSimulator, logs: Logs) -> Assignment:
    """Columns for the model's signals and commands.

    Raises:
        BadInput: no column is one of the model's, and none is a clock.
    """
    wanted = (*simulator.signals, *(f"ctrl.{name}" for name in simulator.commands))
    inputs, units = actuator_inputs(simulator.model), signal_units(simulator)

    def fits(found: Match) -> bool:
        return is_unit_of(found.unit, units.get(found.name, ""))

    free = [name for name in logs.shared if name not in (RUN, TIME)]
    matches = tuple(filter(fits, proposals(wanted, free, inputs)))
    if not logs.timed and not matches:
        raise _nothing_fits(simulator, wanted, logs)
    rest = [name for name in free if name not in {found.column for found in matches}]
    switched = [one for one in switches(simulator.commands, rest) if is_switch(logs.sources, one.column)]
    needed = _needed(wanted, matches)
    follows = follow(simulator, {found.name for found in matches}) & {*needed}
    taken = {RUN, TIME, *_own(simulator, logs), *(found.column for found in (*matches, *switched))}
    left = [name for name in free if name not in taken and not name.startswith(LIKE_THE_MODEL)]
    numbers = [name for name in left if needed and is_numeric(logs.sources, name)]
    lacking = {name: could_be(name, wanted, numbers, inputs) for name in needed if name not in follows}
    if (guess := last_one(lacking)) and fits(guess):
        matches, lacking, taken = (*matches, guess), {}, taken | {guess.column}
    matches = tuple(sorted(matches, key=lambda one: wanted.index(one.name)))
    in_degrees = bool(simulator.spec.compiler.degree)
    read = by_values(simulator.model, in_degrees, matches, units, inputs, logs.sources, logs.timed)
    fixed = unmeasured_bodies(simulator.model, lacking)
    missing = ({} if logs.timed else {TIME: logs.rising(taken)}) | without_free(lacking, fixed)
    unused = tuple(name for name in logs.names if name not in taken)
    tied = tuple(name for name in needed if name in follows)
    return Assignment((*read.matches, *switched), missing, fixed, tied, unused, read.questions)


def _needed(wanted: Sequence[str], matches: Sequence[Match]) -> list[str]:
    """Positions and commands without a column; a speed that was measured stands for its position."""
    have = {found.name for found in matches}
    seen = have | {name.replace("qvel.", "qpos.", 1) for name in have if name.startswith("qvel.")}
    return [name for name in wanted if not name.startswith("qvel.") and name not in seen]


def _own(simulator: MujocoSimulator, logs: Logs) -> list[str]:
    """Columns with names of the model that are neither signals of joints nor commands."""
    return [
        *measured_sensors(simulator.model, logs.shared),
        *(f"enable.{name}" for name in simulator.commands),
        *wrenches_of(simulator, logs.shared),
    ]


def _nothing_fits(simulator: MujocoSimulator, wanted: Sequence[str], logs: Logs) -> BadInput:
    return BadInput(
        "no column is one of the model's, and none a clock",
        f"the model has {_few(wanted)}; the log has {_few(logs.names)}; write a problem file that maps them: "
        f'[time] column = "...", [signals."{(*simulator.signals, "qpos.joint")[0]}"] column = "..."',
        where=", ".join(map(str, logs.paths)),
    )


def _few(names: Sequence[str], most: int = 6) -> str:
    """The first of some names, and how many more there are."""
    shown = ", ".join(f"'{name[:40]}'" for name in names[:most])
    return shown + (f" and {len(names) - most} more" if len(names) > most else "") or "nothing"
