"""Measured data: runs of commands and signals on one clock, padded to one rectangle.

| key of ``data``  | shape     | meaning                                                                              |
|------------------|-----------|--------------------------------------------------------------------------------------|
| ``"time"``       | (R, T)    | instant of the row [s], strictly increasing; continued at the median step in padding |
| ``"command"``    | (R, T, U) | command from this row on, until the next row; the last one in padding                |
| ``"enable"``     | (R, T, U) | 1 while the actuator is on, 0 while it is off                                        |
| ``"signal"``     | (R, T, S) | measured value [SI]; 0 where ``measured`` is False, never nan                        |
| ``"measured"``   | (R, T, S) | whether this cell was measured                                                       |
| ``"mask"``       | (R, T)    | whether the row exists; False in the padding at the end of the shorter runs          |

Runs may have different lengths and clocks, and signals different rates.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Int
from numpy.typing import ArrayLike
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.measurements.checks import check_columns
from onlinebayes.measurements.known_starts import KnownStart
from onlinebayes.runs import BadInput

Columns = Mapping[str, ArrayLike]
BetweenRows = Literal["held", "curve"]


@dataclass(frozen=True)
class Signal:
    """One measured quantity and how well its sensor knows it.

    Args:
        name: the simulator's name of it, e.g. ``"qpos.carriage"``.
        unit: SI unit, e.g. ``"m"``; empty when not known.
        sd: standard deviation of the sensor's noise [unit], or None to estimate it from the data.
        resolution: smallest step that the sensor reports [unit], or None when not known.

    Raises:
        BadInput: an sd or a resolution that is not finite and positive.
    """

    name: str
    unit: str = ""
    sd: float | None = None
    resolution: float | None = None

    def __post_init__(self) -> None:
        for name, value in (("sd", self.sd), ("resolution", self.resolution)):
            if value is not None and not (np.isfinite(value) and value > 0):
                raise BadInput(
                    f"{name} = {value} is not a positive number", "leave it out when it is not known", where=self.name
                )


@dataclass(frozen=True)
class Measurement:
    """R runs of at most T rows, U commands and S signals; see the module's table for ``data``.

    Args:
        data: TensorDict of batch size (R, T) with the six keys above.
        signals: the S signals, in the order of the last axis of ``"signal"``.
        commands: names of the U actuators, in the order of the last axis of ``"command"``.
        runs: names of the R runs, each once.
        held_over_gaps: whether commands are held through rows that seem to be missing, too, and not lost there with
            what was commanded in them.
        idle_before: whether no command was given before a run's first row, and not the one that it holds.
        between_rows: how commands go from one row to the next: held, on a curve through the rows because they were
            sent more often than rows were written, or None where nobody said (they are held).
        starts: what is known of the state in which a run begins, ``qpos.<joint>`` or ``qvel.<joint>`` -> that.
    """

    data: TensorDict
    signals: tuple[Signal, ...]
    commands: tuple[str, ...]
    runs: tuple[str, ...]
    held_over_gaps: bool = False
    idle_before: bool = False
    between_rows: BetweenRows | None = None
    starts: Mapping[str, KnownStart] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.data.batch_size) != 2 or self.data.batch_size[0] != len(self.runs):
            raise ValueError(f"data has batch size {tuple(self.data.batch_size)}, {len(self.runs)} runs are named")
        if len(set(self.runs)) != len(self.runs):
            raise ValueError(f"run names repeat: {self.runs}")
        for key, width in (
            ("time", None),
            ("mask", None),
            ("command", len(self.commands)),
            ("enable", len(self.commands)),
            ("signal", len(self.signals)),
            ("measured", len(self.signals)),
        ):
            wanted = tuple(self.data.batch_size) + (() if width is None else (width,))
            if tuple(self.data[key].shape) != wanted:
                raise ValueError(f"'{key}' has shape {tuple(self.data[key].shape)}, it must be {wanted}")

    @classmethod
    def from_runs(
        cls,
        runs: Mapping[str, Columns],
        signals: Sequence[Signal] | None = None,
        commands: Sequence[str] | None = None,
        *,
        dtype: torch.dtype = torch.float64,
        device: torch.device | str = "cpu",
    ) -> Measurement:
        """Build a measurement from arrays: run name -> column name -> values (T,).

        Args:
            runs: the columns are the contract's: ``"time"`` [s], ``"ctrl.<actuator>"``, ``"enable.<actuator>"`` (1
                where it is left out), and signals such as ``"qpos.<joint>"`` (nan: not
                measured). Runs may lack a signal, not a command.
            signals: the signals to keep, with their noise; by default every other column, without.
            commands: the actuators, in the simulator's order; by default those of the first run.
            dtype, device: of the tensors.

        Raises:
            BadInput: no runs or rows, lengths that differ, times that do not increase, values that are infinite, a
                command that is missing or nan.
        """
        if not runs:
            raise BadInput("no runs", "give at least one run with at least two rows")
        arrays = {run: _arrays(run, columns) for run, columns in runs.items()}
        if commands is None:
            commands = [name.removeprefix("ctrl.") for name in next(iter(arrays.values())) if name.startswith("ctrl.")]
        if signals is None:
            signals = [Signal(name) for name in _signal_names(arrays.values())]
        rows = max(len(columns["time"]) for columns in arrays.values())
        filled = [_fill(columns, [s.name for s in signals], commands, rows, run) for run, columns in arrays.items()]
        tensors = {
            key: torch.as_tensor(np.stack([f[key] for f in filled])).to(
                device=device, dtype=torch.bool if key in ("mask", "measured") else dtype
            )
            for key in filled[0]
        }
        data = TensorDict(tensors, batch_size=(len(arrays), rows), device=torch.device(device))
        return cls(data, tuple(signals), tuple(commands), tuple(arrays))

    @property
    def lengths(self) -> Int[Tensor, " R"]:
        """Number of rows of each run."""
        return self.data["mask"].sum(-1)

    @property
    def durations(self) -> tuple[float, ...]:
        """Time from the first to the last row of each run [s]."""
        last = (self.lengths - 1).unsqueeze(-1)
        return tuple((self.data["time"].gather(-1, last).squeeze(-1) - self.data["time"][:, 0]).tolist())

    def select(self, runs: Iterable[str]) -> Measurement:
        """The measurement of some runs, in the order given, without padding that only the others needed.

        Raises:
            BadInput: a run that is not there, or none at all.
        """
        names = tuple(runs)
        if not names:
            raise BadInput("no run is selected", f"known: {', '.join(self.runs)}")
        for name in names:
            if name not in self.runs:
                raise BadInput(f"run '{name}' is unknown", f"known: {', '.join(self.runs)}")
        index = torch.tensor([self.runs.index(name) for name in names], device=self.data.device)
        rows = int(self.lengths[index].max())
        return replace(self, data=self.data[index, :rows], runs=names)

    def rows(self, run: str, start: int, stop: int, name: str | None = None) -> Measurement:
        """Rows ``start`` to ``stop`` (exclusive) of one run, as a measurement of one run called ``name``.

        Rows from within the run do not begin where the run does: what is known of its start does not hold there.
        """
        alone = self.select([run])
        kept = {key: one for key, one in self.starts.items() if start == 0 or one.value is None}
        return replace(alone, data=alone.data[:, start:stop], runs=(name or run,), starts=kept)

    def after(self, seconds: float) -> Measurement:
        """Every run without its first ``seconds`` [s]; it begins then, and what is known of its start holds there.

        Raises:
            BadInput: a run that does not last so long.
        """
        parts = []
        for run, time, rows in zip(self.runs, self.data["time"], self.lengths.tolist(), strict=True):
            first = int((time[:rows] < time[0] + seconds).sum())
            if rows - first < 2:
                raise BadInput(f"run '{run}' has nothing after its first {seconds:g} s", "leave less out")
            parts.append(self.rows(run, first, rows))
        return replace(concatenate(parts), starts=self.starts)

    def seen(self) -> Measurement:
        """The measurement without signals of which no run has a value; unchanged where none has any."""
        kept = [s for s, any_ in enumerate(self.data["measured"].flatten(0, 1).any(0).tolist()) if any_]
        if len(kept) in (0, len(self.signals)):
            return self
        data = self.data.clone(recurse=False)
        data["signal"], data["measured"] = data["signal"][..., kept], data["measured"][..., kept]
        return replace(self, data=data, signals=tuple(self.signals[s] for s in kept))

    def with_signals(self, signals: Iterable[Signal]) -> Measurement:
        """The same values with other signal descriptions (sd, resolution, unit) for the signals of these names."""
        given = {signal.name: signal for signal in signals}
        return replace(self, signals=tuple(given.get(signal.name, signal) for signal in self.signals))

    def with_starts(self, starts: Mapping[str, KnownStart]) -> Measurement:
        """The same runs with what is known of how they begin."""
        return replace(self, starts=dict(starts))

    def to(self, device: torch.device | str) -> Measurement:
        """The same measurement with its tensors on another device."""
        return replace(self, data=self.data.to(device))


def concatenate(measurements: Sequence[Measurement]) -> Measurement:
    """One measurement with the runs of several that share signals and commands, padded to the longest.

    Raises:
        BadInput: a run name that stands in two of them.
        ValueError: signals or commands that differ.
    """
    first = measurements[0]
    names = [run for measurement in measurements for run in measurement.runs]
    if repeated := sorted({name for name in names if names.count(name) > 1}):
        raise BadInput(f"run '{repeated[0]}' stands in two measurements", "give each run a name of its own")
    if any((m.signals, m.commands) != (first.signals, first.commands) for m in measurements):
        raise ValueError("the measurements differ in their signals or commands")
    rows = max(m.data.batch_size[1] for m in measurements)
    data = torch.cat([_pad(m.data, rows) for m in measurements])
    return replace(first, data=data, runs=tuple(names))


def _pad(data: TensorDict, rows: int) -> TensorDict:
    missing = rows - data.batch_size[1]
    if missing == 0:
        return data
    end = data[:, -1:].expand(data.batch_size[0], missing).clone()
    step = (data["time"][:, -1:] - data["time"][:, :1]) / max(data.batch_size[1] - 1, 1)
    count = torch.arange(1, missing + 1, device=step.device, dtype=step.dtype)
    end["time"] = end["time"] + count * torch.where(step > 0, step, torch.ones_like(step))
    for key in ("signal", "measured", "mask"):
        end[key] = torch.zeros_like(end[key])
    return torch.cat([data, end], dim=1)


def _arrays(run: str, columns: Columns) -> dict[str, np.ndarray]:
    arrays = {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}
    check_columns(arrays, f"run '{run}'")
    return arrays


def _signal_names(runs: Iterable[Mapping[str, np.ndarray]]) -> list[str]:
    names = dict.fromkeys(name for columns in runs for name in columns)
    return [name for name in names if name != "time" and not name.startswith(("ctrl.", "enable."))]


def _fill(
    columns: Mapping[str, np.ndarray], signals: Sequence[str], commands: Sequence[str], rows: int, run: str
) -> dict[str, np.ndarray]:
    """One run's six arrays, padded to ``rows``."""
    time = columns["time"]
    length, extra = len(time), rows - len(time)
    step = float(np.median(np.diff(time))) if length > 1 else 1.0
    off = np.ones(length)
    command, enable = np.zeros((length, len(commands))), np.ones((length, len(commands)))
    for j, name in enumerate(commands):
        enable[:, j] = columns.get(f"enable.{name}", off)
        if f"ctrl.{name}" in columns:
            command[:, j] = columns[f"ctrl.{name}"]
        elif enable[:, j].any():
            raise BadInput(
                f"no column 'ctrl.{name}'",
                f"give the command of actuator '{name}', or 'enable.{name}' = 0 throughout",
                where=f"run '{run}'",
            )
    unmeasured = np.full(length, np.nan)
    signal = np.stack([columns.get(name, unmeasured) for name in signals], -1) if signals else np.zeros((length, 0))
    measured = ~np.isnan(signal)
    ends = ((0, extra), (0, 0))
    return {
        "time": np.concatenate([time, time[-1] + step * np.arange(1, extra + 1)]),
        "command": np.pad(command, ends, mode="edge"),
        "enable": np.pad(enable, ends, mode="edge"),
        "signal": np.pad(np.where(measured, signal, 0.0), ends),
        "measured": np.pad(measured, ends),
        "mask": np.arange(rows) < length,
    }
