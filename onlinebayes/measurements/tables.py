"""Measurement tables, whatever their format -> :class:`Measurement`, by the model's names.

    run,time,ctrl.motor,qpos.carriage,sensor.reference
    plain,0,2.53,7.45e-06,0.00011
    plain,0.001,,1.43e-05,0.00012

| column                        | here                                                                          |
|-------------------------------|-------------------------------------------------------------------------------|
| ``run``                       | rows of a run are contiguous; without the column the file is one run          |
| ``time``                      | [s], strictly increasing within a run, not necessarily uniform                |
| ``ctrl.<actuator>``           | command; an empty cell holds the last one of the run                          |
| ``xfrc.<body>.0`` to ``.5``    | measured wrench from outside, held likewise; 0 in a table without it          |
| ``enable.<actuator>``         | 0 while the actuator is off, else 1; an empty cell holds the last one         |
| ``qpos.<joint>``, ...         | a signal of the model; an empty cell was not measured; quaternions made unit  |
| ``meta.*``, other unknown     | kept out and named in the notes, like ``sensor.*`` that the model lacks       |

A run may stand in several tables, each with some of its columns: see :mod:`.joining`.
An unknown joint or actuator is an error unless ``ignore`` lists the column. Logs with names of their own (MCAP, ...)
are mapped column by column; see ``formats`` for what their columns are called.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from onlinebayes.measurements.checks import check_columns
from onlinebayes.measurements.clocks import TIME, OnClock, TimedSource
from onlinebayes.measurements.formats import Columns, Source, open_source
from onlinebayes.measurements.inputs import begun, blank_while_off, first_commanded, held
from onlinebayes.measurements.joining import JoinedSource, joined, untied
from onlinebayes.measurements.latency import advanced
from onlinebayes.measurements.mapping import SECONDS, CommandColumn, SignalColumn, TimeColumn
from onlinebayes.measurements.matching import matches
from onlinebayes.measurements.measurement import Measurement, Signal
from onlinebayes.measurements.quaternions import normalised, quaternions
from onlinebayes.measurements.stretches import check_rises, run_rows
from onlinebayes.runs import BadInput, similar

STATE = ("qpos", "qvel")
ONE_RUN = "tables are joined where their column 'run' has the same names: name the runs alike there, or write one table"


@dataclass(frozen=True)
class TableReader:
    """Reads tables into the vocabulary of one model.

    Args:
        signals: the model's signals, in its order, e.g. ``Simulator.signals`` with units.
        commands: the model's actuators, in its order, e.g. ``Simulator.commands``.
        mapped: signals that come from another column, or in another unit.
        commanded: commands that do.
        clock: the column that holds the time.
        ignore: columns (globs) to leave out though they look like the model's.
        known: addresses such as ``"sensor.force"`` that the model has but that are not compared.
        note: told once a table what was left out.
        clocks: of the tables, by path, that have another one.
    """

    signals: Sequence[Signal]
    commands: Sequence[str]
    mapped: Sequence[SignalColumn] = ()
    commanded: Sequence[CommandColumn] = ()
    clock: TimeColumn = SECONDS
    ignore: Sequence[str] = ()
    known: Sequence[str] = ()
    note: Callable[[str], None] = field(default=lambda _line: None)
    clocks: Mapping[Path, TimeColumn] = field(default_factory=dict)

    def read(self, paths: Iterable[str | Path]) -> Measurement:
        """All runs of some tables.

        Raises:
            BadInput: anything that breaks the rules of the table above, with file, row and column.
        """
        sources = {mapped.signal.name: mapped for mapped in self.mapped}
        wanted = [sources.get(s.name, SignalColumn(s)) for s in self.signals]
        runs: dict[str, Mapping[str, np.ndarray]] = {}
        origin: dict[str, Path] = {}
        columns: dict[str, list[str]] = {}
        tables = self._tables(paths)
        there = {name for source in tables for name in source.names}
        renamed = any(mapped.source != mapped.signal.name for mapped in self.mapped)
        if renamed and not any(one.source in there for one in wanted):  # in no table, be it beside one of commands
            self._check_mapped(set(), {str(source.path): list(source.names) for source in tables})
        self._check_tied(tables, wanted)
        for source in tables:
            path = source.path
            columns[str(path)] = list(source.names)
            for run, values in self._runs_of(source, wanted).items():
                if run in runs:
                    again = "is given twice" if path == origin[run] else f"also stands in {origin[run]}"
                    raise BadInput(f"run '{run}' {again}", "give each run a name of its own", where=str(path))
                runs[run], origin[run] = values, path
        # All by the same amount: what drifts from run to run goes on in a clock that they share.
        earliest = min((values[TIME][0] for values in runs.values()), default=0.0)
        runs = {run: {**values, TIME: values[TIME] - earliest} for run, values in runs.items()}
        found = {name for values in runs.values() for name in values}
        present = [w.signal for w in wanted if w.signal.name in found]
        self._check_mapped(found, columns)
        self._note_idle(runs, [signal.name for signal in present])
        return Measurement.from_runs(runs, present, self.commands)

    def _note_idle(self, runs: Mapping[str, Mapping[str, np.ndarray]], signals: Sequence[str]) -> None:
        """Say where nothing is commanded while something moves: perhaps the commands stand in other columns."""
        told = [
            values[f"ctrl.{name}"] for values in runs.values() for name in self.commands if f"ctrl.{name}" in values
        ]
        if not told or any(np.any(command != 0) for command in told):
            return
        moving = [name for name in signals if any(_varies(values.get(name)) for values in runs.values())]
        if moving:
            self.note(f"every command is 0 in every row, while {moving[0]} moves: are they in other columns?")

    def _tables(self, paths: Iterable[str | Path]) -> list[TimedSource]:
        """The tables, each with a clock, those that share runs joined."""
        sources = []
        for source in (open_source(Path(path)) for path in paths):
            clock = self.clocks.get(source.path, self.clock)
            if missing := [column for column in clock.columns if column not in source.names]:
                near = _nearest(missing[0], source.names) or f"the table has {_list(source.names)}"
                cure = f'{near}; name its column in the problem file: [time] column = "..."'
                raise BadInput(f"no column '{missing[0]}'", cure, where=f"{source.path}, row 1")
            sources.append(OnClock(source, clock))
        tables = joined(sources)
        for one in tables:
            if isinstance(one, JoinedSource):
                why = f"as topics of one recording, run '{one.run}'" if one.run else "for they share runs"
                self.note(f"{one.path}: joined by '{one.clock}', {why}")
        return tables

    def _check_tied(self, tables: Sequence[TimedSource], wanted: Sequence[SignalColumn]) -> None:
        """Commands whose clock is that of no table with signals."""
        signals, commands = {one.source for one in wanted}, {one.source for one in self._inputs().values()}
        if any(commands & {*one.names} and not signals & {*one.names} for one in tables) and (doubt := untied(tables)):
            raise doubt

    def _runs_of(self, source: TimedSource, wanted: Sequence[SignalColumn]) -> dict[str, dict[str, np.ndarray]]:
        path, names = source.path, set(source.names)
        self._check_beside(source)
        inputs = {name: one for name, one in self._inputs().items() if one.source in names}
        inputs = {name: one for name, one in inputs.items() if not self._ignored(one.source)}
        found = [w for w in wanted if w.source in names and not self._ignored(w.source)]
        sources = {name for one in inputs.values() for name in one.sources}
        taken = {"run", TIME, *sources, *(w.source for w in found)}
        if "run" in names & {*sources, *(w.source for w in found)}:
            cure = "map the column that holds the quantity, or call the column of numbers otherwise"
            raise BadInput("'run' names the runs, and is no number", cure, where=f"{path}, row 1, column 'run'")
        self._classify([name for name in source.names if name not in taken], path)
        if not found:
            raise BadInput(
                "commands alone cannot stand by themselves" if inputs else "no column that the model has",
                (f"{ONE_RUN}; " if inputs else "")
                + (f"give one of {_list([w.source for w in wanted])}" if wanted else "the model has no joint or sensor")
                + _instead([name for name in source.names if name not in taken]),
                where=f"{path}, row 1",
            )
        text = [name for name in ("run",) if name in names]
        read = source.columns(sorted(taken & names), text, sorted(sources))
        for clock, wraps in source.wraps:
            self.note(f"{path}: '{clock}' begins again at {wraps:.10g}, and was put straight")
        for one in (inputs[name] for name in inputs if name.startswith("ctrl.")):
            if told := read.switches & {*one.sources}:
                self.note(f"{path}: '{min(told)}' is written as True and False: read as commands of 1 and 0")
        check_rises(read[TIME], source.clock, read, source)
        return {
            run: self._one_run(read, rows, found, inputs, source, _where(source, run))
            for run, rows in run_rows(read, path).items()
        }

    def _inputs(self) -> dict[str, CommandColumn]:
        """``ctrl.<actuator>`` and ``enable.<actuator>`` -> the column each comes from."""
        commanded = {one.actuator: one for one in self.commanded}
        inputs = {f"ctrl.{name}": commanded.get(name, CommandColumn(name)) for name in self.commands}
        switches = {f"enable.{one.actuator}": one.enable or f"enable.{one.actuator}" for one in inputs.values()}
        return inputs | {name: CommandColumn(name.partition(".")[2], column) for name, column in switches.items()}

    def _one_run(
        self,
        read: Columns,
        rows: slice,
        found: Sequence[SignalColumn],
        inputs: Mapping[str, CommandColumn],
        source: TimedSource,
        where: str,
    ) -> dict[str, np.ndarray]:
        numbers = read.rows[rows]
        values = {TIME: read[TIME][rows]}
        for name, one in inputs.items():
            cells = (held(name, read[column][rows], where, numbers) for column in one.sources)
            values[name] = one.value(*(begun(column) for column in cells) if one.measured else cells)
        for name in self.commands:
            if CommandColumn(name).measured:  # nothing pushed while nobody measured
                values.setdefault(f"ctrl.{name}", np.zeros(len(numbers)))
        for w in found:
            values[w.signal.name] = w.value(read[w.source][rows])
        if source.joined and 0 < (first := first_commanded(self.commands, values)) < len(numbers):
            before = values[TIME][first] - values[TIME][0]
            values = {name: column[first:] for name, column in values.items()}
            numbers = numbers[first:]
            self.note(f"{where}: the {before:.3g} s before the first command are left out")
        for name in self.commands:
            if f"ctrl.{name}" in inputs:
                blank_while_off(name, inputs[f"ctrl.{name}"].source, values, where, numbers)
        check_columns(values, where, numbers, source.clock)
        for w in found:
            values[w.signal.name] = advanced(values["time"], values[w.signal.name], w.latency)
        for quaternion in quaternions(s.name for s in self.signals):
            values.update(normalised(values, quaternion, where, numbers))
        self._check_commanded(values, source)
        return values

    def _check_beside(self, source: Source) -> None:
        """A switch that was named but is not there would leave its actuator on throughout, a factor would be 1."""
        for one in self.commanded:
            for column, what in ((one.enable, "switches"), (one.times, "multiplies the command of")):
                if column and (column not in source.names or self._ignored(column)):
                    raise BadInput(
                        f"no column '{column}', which {what} the actuator '{one.actuator}'",
                        _there(column, source.names),
                        where=f"{source.path}, row 1",
                    )

    def _check_commanded(self, values: Mapping[str, np.ndarray], source: Source) -> None:
        for name, one in ((name, self._inputs()[f"ctrl.{name}"]) for name in self.commands):
            if f"ctrl.{name}" not in values and not (f"enable.{name}" in values and not values[f"enable.{name}"].any()):
                raise BadInput(
                    f"no column '{one.source}', the command of the model's actuator '{name}'",
                    f"add it, or a table that has it of the same 'run', or 'enable.{name}' with 0 in every row when "
                    "the actuator was off" + _instead(source.names),
                    where=f"{source.path}, row 1",
                )

    def _ignored(self, name: str) -> bool:
        return matches(name, self.ignore)

    def _classify(self, names: Sequence[str], path: Path) -> None:
        """Refuse the columns that name a joint or actuator the model lacks, note the others."""
        unused, later = [], []
        own = {s.name for s in self.signals} | {f"ctrl.{one.actuator}" for one in self.commanded}
        own |= {f"enable.{one.actuator}" for one in self.commanded if one.enable}
        for number, name in enumerate(names, start=1):
            if self._ignored(name):
                continue
            if name in own:  # another column was mapped to it
                unused.append(name)
                continue
            kind, _, target = name.partition(".")
            if kind in ("ctrl", "enable"):
                self._unknown(name, target, self._actuators(), "actuator", path)
            elif kind == "xfrc" and name not in self.commands:
                pushes = [one for one in self.commands if CommandColumn(one).measured]
                self._unknown(name, name, pushes, "input for a measured push called", path)
            elif kind in STATE:
                same = [s.name for s in self.signals if s.name.startswith(f"{kind}.")]
                self._unknown(name, name, same, "joint signal", path)
            elif kind == "qfrc":
                joints = [s.name.partition(".")[2] for s in self.signals if s.name.startswith("qvel.")]
                if target not in joints:
                    self._unknown(name, target, joints, "joint", path)
                later.append(name)
            elif kind == "sensor" and any(name == k or name.startswith(f"{k}.") for k in self.known):
                later.append(name)
            else:
                unused.append(name or f"(column without a name, {number})")
        if unused:
            more = f" and {len(unused) - 50} more" if len(unused) > 50 else ""
            self.note(f"{path}: columns kept out: {', '.join(unused[:50])}{more}")
        if later:
            self.note(f"{path}: columns not compared by this version: {', '.join(later)}")

    def _actuators(self) -> list[str]:
        """The model's own; a machine that has none is not moved by any command."""
        return [name for name in self.commands if not CommandColumn(name).measured]

    def _unknown(self, column: str, name: str, known: Sequence[str], kind: str, path: Path) -> None:
        near = _nearest(name, known) or f"the model has {_list(known)}"
        if not known and kind == "actuator":
            near = f'add it to the model, <actuator><motor name="{name}" joint="..."/></actuator>'
        raise BadInput(
            f"the model has no {kind} '{name}'" if known or kind != "actuator" else "the model has no actuator",
            f"{near}; rename the column, or add it to 'ignore' in the problem file",
            where=f"{path}, row 1, column '{column}'",
        )

    def _check_mapped(self, found: set[str], columns: Mapping[str, Sequence[str]]) -> None:
        """Every mapped signal was ``found`` in one of the tables, path -> its ``columns``, at least."""
        for mapped in self.mapped:
            if mapped.signal.name not in found:
                there = list(dict.fromkeys(name for names in columns.values() for name in names))
                raise BadInput(
                    f"no column '{mapped.source}', which [signals.\"{mapped.signal.name}\"] names",
                    _there(mapped.source, there),
                    where=f"{', '.join([*columns][:3])}{', ...' if len(columns) > 3 else ''}, row 1",
                )


def _varies(column: np.ndarray | None) -> bool:
    known = np.zeros(0) if column is None else column[np.isfinite(column)]
    return bool(known.size and known.max() > known.min())


def _where(source: Source, run: str) -> str:
    """Return the place that a message about a run names beside the row; joined tables count rows in each run."""
    return f"{source.path}, run '{run}'" if isinstance(source, JoinedSource) else str(source.path)


def _instead(names: Iterable[str]) -> str:
    """List the columns that a table does have, for the mapping; nothing where it has a clock alone."""
    there = _others(names)
    return f", or map one of its columns: {_list(there)}" if there else ""


def _there(column: str, names: Sequence[str]) -> str:
    """Why a column that was named is not there, and what is."""
    if column in names:
        return "it is there, but 'ignore' leaves it out: name other columns there"
    near = _nearest(column, others := _others(names))
    return f"{near}; the columns are {_list(others)}" if near else f"the columns are {_list(others)}"


def _others(names: Iterable[str]) -> list[str]:
    """The columns that may be a signal or a command."""
    return [name for name in names if name not in ("run", "time", "")]


def _nearest(name: str, known: Sequence[str]) -> str:
    near = similar(name, known, cutoff=0.5)
    return f"nearest: {', '.join(near)}" if near else ""


def _list(names: Sequence[str], most: int = 12) -> str:
    shown = ", ".join(f"'{name}'" for name in names[:most])
    return (shown + (f" and {len(names) - most} more" if len(names) > most else "")) or "nothing"
