"""Measurement tables (CSV or Parquet) -> :class:`Measurement`, by the model's names.

    run,time,ctrl.motor,qpos.carriage,sensor.reference
    plain,0,2.53,7.45e-06,0.00011
    plain,0.001,,1.43e-05,0.00012

| column                        | here                                                                          |
|-------------------------------|-------------------------------------------------------------------------------|
| ``run``                       | rows of a run are contiguous; without the column the file is one run          |
| ``time``                      | [s], strictly increasing within a run, not necessarily uniform                |
| ``ctrl.<actuator>``           | command; an empty cell holds the last one of the run                          |
| ``enable.<actuator>``         | 0 while the actuator is off, else 1; an empty cell holds the last one         |
| ``qpos.<joint>``, ...         | a signal of the model; an empty cell was not measured                         |
| ``meta.*``, other unknown     | kept out and named in the notes, like ``sensor.*`` that the model lacks       |

An unknown joint or actuator is an error unless ``ignore`` lists the column.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from onlinebayes.measurements.checks import check_columns
from onlinebayes.measurements.files import Columns, columns, header
from onlinebayes.measurements.latency import advanced
from onlinebayes.measurements.measurement import Measurement, Signal
from onlinebayes.runs import BadInput

STATE = ("qpos", "qvel")
LATER = ("qfrc", "sensor")


@dataclass(frozen=True)
class SignalColumn:
    """A signal and how a table's column becomes it: value = sign scale cell + offset.

    Args:
        signal: the model's signal, with its noise.
        column: the table's column; the signal's own name by default.
        scale: what multiplies the cell, units and sign included [unit of the signal / unit of the column].
        offset: what is added then [unit of the signal].
        latency: seconds by which the column lags (see :mod:`.latency`) [s].
    """

    signal: Signal
    column: str = ""
    scale: float = 1.0
    offset: float = 0.0
    latency: float = 0.0


@dataclass(frozen=True)
class TableReader:
    """Reads tables into the vocabulary of one model.

    Args:
        signals: the model's signals, in its order, e.g. ``Simulator.signals`` with units.
        commands: the model's actuators, in its order, e.g. ``Simulator.commands``.
        mapped: signals that come from another column, or in another unit.
        ignore: columns (globs) to leave out though they look like the model's.
        known: addresses such as ``"sensor.force"`` that the model has but that are not compared.
        note: told once a table what was left out.
    """

    signals: Sequence[Signal]
    commands: Sequence[str]
    mapped: Sequence[SignalColumn] = ()
    ignore: Sequence[str] = ()
    known: Sequence[str] = ()
    note: Callable[[str], None] = field(default=lambda _line: None)

    def read(self, paths: Iterable[str | Path]) -> Measurement:
        """All runs of some tables.

        Raises:
            BadInput: anything that breaks the rules of the table above, with file, row and column.
        """
        sources = {mapped.signal.name: mapped for mapped in self.mapped}
        wanted = [sources.get(s.name, SignalColumn(s)) for s in self.signals]
        runs: dict[str, Mapping[str, np.ndarray]] = {}
        origin: dict[str, Path] = {}
        for path in map(Path, paths):
            for run, values in self._runs_of(path, wanted).items():
                if run in runs:
                    again = "is given twice" if path == origin[run] else f"also stands in {origin[run]}"
                    raise BadInput(f"run '{run}' {again}", "give each run a name of its own", where=str(path))
                runs[run], origin[run] = values, path
        found = {name for values in runs.values() for name in values}
        present = [w.signal for w in wanted if w.signal.name in found]
        self._check_mapped(found)
        return Measurement.from_runs(runs, present, self.commands)

    def _runs_of(self, path: Path, wanted: Sequence[SignalColumn]) -> dict[str, dict[str, np.ndarray]]:
        names = header(path)
        if "time" not in names:
            raise BadInput("no column 'time'", _nearest("time", names) or _list(names), where=f"{path}, row 1")
        found = [w for w in wanted if (w.column or w.signal.name) in names]
        inputs = [name for kind in ("ctrl", "enable") for c in self.commands if (name := f"{kind}.{c}") in names]
        inputs = [name for name in inputs if not self._ignored(name)]
        found = [w for w in found if not self._ignored(w.column or w.signal.name)]
        taken = {"run", "time", *inputs, *(w.column or w.signal.name for w in found)}
        self._classify([name for name in names if name not in taken], path)
        if not found:
            raise BadInput(
                "no column that the model has",
                f"give one of {_list([w.column or w.signal.name for w in wanted])}",
                where=f"{path}, row 1",
            )
        text = [name for name in ("run",) if name in names]
        read = columns(path, sorted(taken & set(names)), text, inputs)
        return {run: self._one_run(read, rows, found, inputs, f"{path}") for run, rows in _run_rows(read, path).items()}

    def _one_run(
        self, read: Columns, rows: slice, found: Sequence[SignalColumn], inputs: Sequence[str], where: str
    ) -> dict[str, np.ndarray]:
        numbers = read.rows[rows]
        values = {"time": read["time"][rows]}
        for name in inputs:
            values[name] = _held(name, read[name][rows], where, numbers)
        for name in self.commands:
            _blank_while_off(name, values, where, numbers)
        for w in found:
            values[w.signal.name] = read[w.column or w.signal.name][rows] * w.scale + w.offset
        check_columns(values, where, numbers)
        for w in found:
            values[w.signal.name] = advanced(values["time"], values[w.signal.name], w.latency)
        for name in self.commands:
            if f"ctrl.{name}" not in values and not (f"enable.{name}" in values and not values[f"enable.{name}"].any()):
                raise BadInput(
                    f"no column 'ctrl.{name}', the command of the model's actuator '{name}'",
                    f"add it, or 'enable.{name}' with 0 in every row when the actuator was off",
                    where=f"{where}, row 1",
                )
        return values

    def _ignored(self, name: str) -> bool:
        return any(fnmatchcase(name, pattern) for pattern in self.ignore)

    def _classify(self, names: Sequence[str], path: Path) -> None:
        """Refuse the columns that name a joint or actuator the model lacks, note the others."""
        unused, later = [], []
        for number, name in enumerate(names, start=1):
            if self._ignored(name):
                continue
            if name in (s.name for s in self.signals):  # another column was mapped to this signal
                unused.append(name)
                continue
            kind, _, target = name.partition(".")
            if kind in ("ctrl", "enable"):
                self._unknown(name, target, self.commands, "actuator", path)
            elif kind in STATE:
                same = [s.name for s in self.signals if s.name.startswith(f"{kind}.")]
                self._unknown(name, name, same, "joint signal", path)
            elif kind == "qfrc":
                joints = [s.name.partition(".")[2] for s in self.signals if s.name.startswith("qvel.")]
                if target not in joints:
                    self._unknown(name, target, joints, "joint", path)
                later.append(name)
            elif kind == "xfrc":
                raise BadInput(
                    "a measured wrench from outside is not applied to the model by this version",
                    "add the column to 'ignore' in the problem file if the replay may go without it",
                    where=f"{path}, row 1, column '{name}'",
                )
            elif kind in LATER and any(name == k or name.startswith(f"{k}.") for k in self.known):
                later.append(name)
            else:
                unused.append(name or f"(column without a name, {number})")
        if unused:
            self.note(f"{path}: columns kept out: {', '.join(unused)}")
        if later:
            self.note(f"{path}: columns not compared by this version: {', '.join(later)}")

    def _unknown(self, column: str, name: str, known: Sequence[str], kind: str, path: Path) -> None:
        near = _nearest(name, known) or f"the model has {_list(known)}"
        raise BadInput(
            f"the model has no {kind} '{name}'",
            f"{near}; rename the column, or add it to 'ignore' in the problem file",
            where=f"{path}, row 1, column '{column}'",
        )

    def _check_mapped(self, found: set[str]) -> None:
        for mapped in self.mapped:
            if mapped.signal.name not in found:
                raise BadInput(
                    f"no table has the column '{mapped.column or mapped.signal.name}'",
                    "name the column as the table's header does",
                    where=f'[signals."{mapped.signal.name}"]',
                )


def _run_rows(read: Columns, path: Path) -> dict[str, slice]:
    """Run name -> its rows; the file's stem where there is no run column."""
    if "run" not in read:
        return {path.stem: slice(0, len(read.rows))}
    names = read["run"]
    if (empty := np.flatnonzero(names == "")).size:
        raise BadInput("a row without a run", "name its run", where=f"{path}, row {read.rows[empty[0]]}, column 'run'")
    starts = np.concatenate([[0], np.flatnonzero(names[1:] != names[:-1]) + 1])
    ends = np.concatenate([starts[1:], [len(names)]])
    found: dict[str, slice] = {}
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        if (run := str(names[start])) in found:
            raise BadInput(
                f"run '{run}' begins again (it ended at row {read.rows[found[run].stop - 1]})",
                "put the rows of a run together, or give the second part a name of its own",
                where=f"{path}, row {read.rows[start]}, column 'run'",
            )
        found[run] = slice(start, end)
    return found


def _held(name: str, values: np.ndarray, where: str, rows: np.ndarray) -> np.ndarray:
    """Each empty cell takes the last value before it; those before the first value stay nan (enable: 1)."""
    last = np.maximum.accumulate(np.where(np.isnan(values), -1, np.arange(len(values))))
    start = 1.0 if name.startswith("enable.") else np.nan
    held = np.where(last >= 0, values[np.maximum(last, 0)], start)
    if name.startswith("enable.") and (wrong := np.flatnonzero(~np.isin(held, (0.0, 1.0)))).size:
        raise BadInput(
            f"enable is {held[wrong[0]]:g}",
            "write 1 while the actuator is on, 0 while it is off",
            where=f"{where}, row {rows[wrong[0]]}, column '{name}'",
        )
    return held


def _blank_while_off(name: str, values: dict[str, np.ndarray], where: str, rows: np.ndarray) -> None:
    """A run's first commands may be empty only while the actuator is off; they become 0, which nothing feels."""
    column = f"ctrl.{name}"
    if column not in values:
        return
    blank = np.isnan(values[column])
    on = values.get(f"enable.{name}", np.ones(len(blank))) != 0
    if (wrong := np.flatnonzero(blank & on)).size:
        raise BadInput(
            "no command yet: the cell is empty and there is none before it in the run",
            "give the command that holds in the run's first row",
            where=f"{where}, row {rows[wrong[0]]}, column '{column}'",
        )
    values[column] = np.where(blank, 0.0, values[column])


def _nearest(name: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
    folded = [k for k in known if k.casefold() == name.casefold()]
    near = folded or near
    return f"nearest: {', '.join(near)}" if near else ""


def _list(names: Sequence[str], most: int = 12) -> str:
    shown = ", ".join(f"'{name}'" for name in names[:most])
    return (shown + (f" and {len(names) - most} more" if len(names) > most else "")) or "nothing"
