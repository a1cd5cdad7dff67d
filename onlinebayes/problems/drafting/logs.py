"""The logs of a draft, each on its clock: topics of one recording as one table, others side by side."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from onlinebayes.measurements import CommandColumn, Measurement, Signal, SignalColumn, TableReader
from onlinebayes.measurements.formats import Source, open_source
from onlinebayes.measurements.units import to_si
from onlinebayes.problems.drafting.clocks import Clock, clock_of, rises, timed
from onlinebayes.problems.drafting.log_columns import shared_columns
from onlinebayes.problems.drafting.matching import Match
from onlinebayes.problems.model import signal_units
from onlinebayes.simulators.mujoco import MujocoSimulator


@dataclass(frozen=True)
class Logs:
    """Logs and their clocks.

    Args:
        paths: of the files.
        sources: the tables, with a column ``time`` where all clocks are clear.
        clocks: of each file that has a clear one.
        unclear: tables without a clear clock.
        untied: clocks that do not overlap, with what to write.
    """

    paths: tuple[Path, ...]
    sources: tuple[Source, ...]
    clocks: tuple[Clock, ...]
    unclear: tuple[Source, ...]
    untied: tuple[str, ...]

    @property
    def shared(self) -> list[str]:
        """The columns that every table has."""
        return shared_columns(self.sources)

    @property
    def names(self) -> tuple[str, ...]:
        """The columns of all tables."""
        return tuple(dict.fromkeys(name for source in self.sources for name in source.names))

    @property
    def timed(self) -> bool:
        """True if every log has a clear clock, so that its table has a column ``time``."""
        return not self.unclear

    def rising(self, taken: Collection[str]) -> tuple[str, ...]:
        """Columns but those taken that could be the clock of the logs that have none by name."""
        shared = [name for name in shared_columns(self.unclear) if name not in taken]
        return tuple(name for name in shared if all(rises(source, name) for source in self.unclear))


def open_logs(paths: Sequence[Path]) -> Logs:
    """The logs with their clocks."""
    sources: Sequence[Source] = [open_source(path) for path in paths]
    found = [clock_of(source) for source in sources]
    clocks = [clock for clock in found if clock is not None]
    unclear = [source for source, clock in zip(sources, found, strict=True) if clock is None]
    untied: list[str] = []
    if not unclear:
        sources, untied = timed(sources, clocks)
    return Logs(tuple(paths), tuple(sources), tuple(clocks), tuple(unclear), tuple(untied))


def measurement_of(
    simulator: MujocoSimulator, logs: Logs, matches: Sequence[Match], unused: Sequence[str]
) -> Measurement:
    """The logs as the problem file will read them.

    Args:
        simulator: gives signals and commands.
        logs: each with a clock.
        matches: what its columns are.
        unused: columns that nothing takes.
    """
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
    columns = [clock.time_column for clock in logs.clocks]
    own = dict(zip(logs.paths, columns, strict=True))
    signals = [Signal(name) for name in simulator.signals]
    ignore = (*unused, "xfrc.*")  # what pushed is the problem file's to add to the model
    reader = TableReader(signals, simulator.commands, signalled, commanded, columns[0], ignore, clocks=own)
    return reader.read(logs.paths)


def _line(found: Match) -> tuple[float, float]:
    """Scale and offset of a column."""
    return found.scale * (to_si(found.unit) if found.unit else 1.0), found.offset
