"""Readings of a log where it does not say how: what is taken, and what is tried beside it.

| question                                    | taken                         | tried                           |
|---------------------------------------------|-------------------------------|---------------------------------|
| what was commanded in rows that are missing | a straight line: rows lost    | the last row's command, held    |
| what was commanded before a run's first row | that row's command, for long  | nothing: it was off             |
| what was commanded between two rows         | the first one's command, held | a curve through the rows        |
| how soft are the constraints of the model   | rigid: a machine              | as MuJoCo has them: its own log |

Under the wrong reading of a gap commands come half of it late, or early, which passes for a delay; a delay or a lag
goes on with what was commanded before a run for its own length, in the first window of every run. Commands that were
sent more often than rows were written come half a row late where they are held, and a servo with nothing wrong but its
gain is followed by no law. What is tried is preferred by the rule by which an addition is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

from onlinebayes.criticism.wiring.faults import Fault
from onlinebayes.identification.data.lost_rows import rows_missing
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.abilities import Measured
from onlinebayes.simulators.identifiable import Identifiable

Constraints = Literal["none", "rigid", "soft"]
"""The way a model's constraints are taken; "none" where it has none, or where its file says how soft they are."""

CHANGING = 0.2
"""Share of the rows at which commands change from which they may change within a row, too."""


class Reading(Fault):
    """A fault's sibling: nothing is wrong with the log, it only does not say how it is to be read."""

    @property
    def lines(self) -> str:
        """Nothing to write in a problem file."""
        return ""

    @property
    def note(self) -> str:
        """What a reader should know where the log was read so; nothing where that is said of the log as it is."""
        return ""

    @property
    def parts_runs(self) -> bool:
        """True if runs fall into other stretches so: both readings are compared over these alone."""
        return False


@dataclass(frozen=True)
class HeldOverGaps(Reading):
    """Commands are held through rows that are missing: the logger writes when something happens."""

    @property
    def says(self) -> str:
        """The reading that is tried."""
        return "commands are held through missing rows"

    def correct(self, measurement: Measurement) -> Measurement:
        """Read so."""
        return replace(measurement, held_over_gaps=True)


@dataclass(frozen=True)
class IdleBefore(Reading):
    """No command was given before the runs: the machine was switched on, the simulator reset."""

    @property
    def says(self) -> str:
        """The reading that is tried."""
        return "there was no command before the runs"

    @property
    def note(self) -> str:
        """Why nothing was commanded before the runs."""
        return (
            "the log does not say what was commanded before a run's first row; no command at all is taken: had the "
            "first row's command been given before, too, the model would follow the log less well"
        )

    def correct(self, measurement: Measurement) -> Measurement:
        """Read so."""
        return replace(measurement, idle_before=True)


@dataclass(frozen=True)
class CurveBetweenRows(Reading):
    """Commands went on between the rows: they were sent more often than rows were written."""

    @property
    def says(self) -> str:
        """The reading that is tried."""
        return "commands go on between rows"

    @property
    def note(self) -> str:
        """Why they are on a curve."""
        return (
            "what was commanded between the log's rows is not known; a curve through the rows is taken, which the "
            "model follows far better than commands that are held until the next row (as if half a row earlier)"
        )

    @property
    def lines(self) -> str:
        """The key that reads the log so."""
        return 'commands_between_rows = "curve"'

    @property
    def parts_runs(self) -> bool:
        """Nobody knows when in a row a command jumped."""
        return True

    def correct(self, measurement: Measurement) -> Measurement:
        """Read so."""
        return replace(measurement, between_rows="curve")


@dataclass(frozen=True, eq=False)
class SoftConstraints(Reading):
    """The model's constraints are as soft as its file has them.

    Args:
        soft: the base model with them.
    """

    soft: Identifiable

    @property
    def says(self) -> str:
        """The reading that is tried."""
        return "constraints are soft"

    @property
    def note(self) -> str:
        """Why they are soft."""
        return "the model's constraints are as soft as its file has them: it follows the log better so than rigid"

    def model(self, simulator: Identifiable) -> Identifiable:
        """The one with soft constraints."""
        del simulator
        return self.soft


def other_readings(found: Identifiable, fit_runs: Measurement, soft: Identifiable | None) -> Iterator[Reading]:
    """Yield the readings to try beside the one under which the runs are read.

    Args:
        found: the model that they are held against.
        fit_runs: the runs, as they are read.
        soft: the base model with constraints as its file has them; None where they are so, or where it has none.
    """
    if soft is not None:
        yield SoftConstraints(soft)
    if not fit_runs.held_over_gaps and not curved(fit_runs) and rows_missing(fit_runs):
        yield HeldOverGaps()
    if not fit_runs.idle_before and commanded_at_once(fit_runs) and remembers_commands(found):
        yield IdleBefore()
    if fit_runs.between_rows is None and changing(fit_runs):
        yield CurveBetweenRows()


def in_words(fit_runs: Measurement, constraints: Constraints) -> Iterator[str]:
    """Describe the reading of a log where it does not say, a sentence each; nothing where every reading is the same."""
    if constraints == "rigid":
        yield "the model's constraints are taken as rigid: no log says how soft they are"
    if count := rows_missing(fit_runs):
        held = "are held until the next row: the model follows the log better so"
        line = "are read on a " + ("curve through the rows" if curved(fit_runs) else "straight line")
        read = held if fit_runs.held_over_gaps else line
        yield f"{count} rows seem to be missing in the log; commands that change across them {read}"


def commanded_at_once(measurement: Measurement) -> bool:
    """Check whether the first row of a run commands something: only then do the readings differ."""
    return bool(measurement.data["command"][:, :1].any())


def curved(measurement: Measurement) -> bool:
    """Check whether commands are read on a curve through the rows."""
    return measurement.between_rows == "curve"


def changing(measurement: Measurement) -> bool:
    """Check whether a command changes at many rows: one that is held for many is held within them."""
    data = measurement.data
    rows = data["mask"][:, 1:]
    changes = (data["command"].diff(dim=1) != 0).any(-1) & rows
    return bool(changes.sum() > CHANGING * rows.sum())


def remembers_commands(simulator: Measured) -> bool:
    """Check whether an effect of the simulator remembers commands."""
    return any(effect.has_command and effect.memory > 0 for effect in simulator.effects)
