"""Sequences of one-second windows that a phone's motion sensors recorded during daily activities.

    signals[s, t] = ten readings of (acc x, y, z, gyr x, y, z) in second t of sequence s,    label[s] its activity

Data: Song et al., "Egocentric Activity Recognition with Multimodal Fisher Vector" (ICASSP 2016), 20 activities x 10
sequences of about 15 s at 10 Hz. :func:`made_up` gives sequences of the same form where the data is absent.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from onlinebayes.runs import BadInput

RATE = 10
"""Readings a second [Hz]."""

SIGNALS = ("accx", "accy", "accz", "gyrx", "gyry", "gyrz")
"""Accelerometer [m/s^2], gyroscope [rad/s]."""

CLASSES = 20


@dataclass(frozen=True)
class Sequences:
    """S sequences of at most T seconds, padded with zeros at their ends.

    Attributes:
        signals: readings [m/s^2, rad/s].
        label: activity of each sequence, in [0, 20).
        length: whole seconds of each.
    """

    signals: Float[Tensor, "S T R 6"]
    label: Int[Tensor, " S"]
    length: Int[Tensor, " S"]

    @property
    def there(self) -> Bool[Tensor, "S T"]:
        """True where a second was recorded."""
        return torch.arange(self.signals.shape[1]) < self.length[:, None]

    @property
    def labels(self) -> Int[Tensor, "S T"]:
        """The activity of each second."""
        return self.label[:, None].expand(self.signals.shape[:2])


def read_sequences(path: str | Path) -> Sequences:
    """The sequences of ``sensors.csv``, in the order of the file; what is left of a last second is dropped.

    Raises:
        BadInput: the file or a column is missing, a value is no number, or a name is not ``actXXseqYY``.
    """
    runs: dict[str, list[list[float]]] = {}
    for line, row in enumerate(rows_of(Path(path), ("run", *(f"sensor.{name}" for name in SIGNALS))), 2):
        try:
            values = [float(value) for value in row[1:]]
        except ValueError:
            values = [math.nan]
        if not all(map(math.isfinite, values)):
            raise BadInput(f"row {line} holds a value that is no number", "leave such a run out", where=str(path))
        runs.setdefault(row[0], []).append(values)
    label = torch.tensor([_activity(name, path) for name in runs], dtype=torch.long)
    if short := [name for name, values in runs.items() if len(values) < RATE] or ["none at all"] * (not runs):
        raise BadInput(f"shorter than a second: {short[0]}", "leave such a run out", where=str(path))
    length = torch.tensor([len(values) // RATE for values in runs.values()])
    signals = torch.zeros(len(runs), int(length.max()), RATE, len(SIGNALS))
    for place, rows, seconds in zip(signals, runs.values(), length.tolist(), strict=True):
        place[:seconds] = torch.tensor(rows[: seconds * RATE]).view(seconds, RATE, -1)
    return Sequences(signals, label, length)


def made_up(number: int = 100, generator: torch.Generator | None = None, *, seconds: int = 15) -> Sequences:
    """Sequences that nobody recorded: ten activities that swing each in its own way, ten that all look like rest.

    Some end early, so that episodes differ in length.
    """
    label = torch.arange(number) % CLASSES
    time = torch.arange(seconds * RATE) / RATE
    moving = (label < CLASSES // 2).float()[:, None, None]
    rate = (0.4 + 0.35 * label.float())[:, None, None] * (1 + 0.05 * _normal((number, 1, 1), generator))
    phase = 2 * math.pi * torch.rand(number, 1, 1, generator=generator) + torch.arange(len(SIGNALS))
    swing = (
        moving
        * (2 + _normal((number, 1, len(SIGNALS)), generator))
        * torch.sin(2 * math.pi * rate * time[None, :, None] + phase)
    )
    signals = swing + 0.3 * _normal((number, len(time), len(SIGNALS)), generator)
    length = seconds - (torch.arange(number) % 7 == 6).long() * 2
    signals = signals.view(number, seconds, RATE, -1)
    return Sequences(signals * (torch.arange(seconds) < length[:, None])[..., None, None], label, length)


def rows_of(path: Path, columns: tuple[str, ...]) -> list[list[str]]:
    """Some columns of a table with a head, as texts.

    Raises:
        BadInput: the file or a column is missing, or a row has another number of columns.
    """
    if not path.exists():
        raise BadInput("is missing", "ONLINEBAYES_DATA names the folder that holds egocentric/", where=str(path))
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = [*csv.reader(file)] or [[]]
    if missing := [name for name in columns if name not in head]:
        raise BadInput(f"has no column '{missing[0]}'", f"it needs {', '.join(columns)}", where=str(path))
    if cut := [line for line, row in enumerate(rows, 2) if len(row) != len(head)]:
        raise BadInput(f"row {cut[0]} has another number of columns than the head", "mend or drop it", where=str(path))
    places = [head.index(name) for name in columns]
    return [[row[place] for place in places] for row in rows]


def _activity(name: str, path: str | Path) -> int:
    """Class of the run ``actXXseqYY``."""
    number = name[3:5]
    if not name.startswith("act") or not number.isdecimal() or not 1 <= int(number) <= CLASSES:
        raise BadInput(f"run '{name}' does not name its activity", "call it actXXseqYY, XX in 01..20", where=str(path))
    return int(number) - 1


def _normal(shape: tuple[int, ...], generator: torch.Generator | None) -> Tensor:
    return torch.randn(shape, generator=generator)
