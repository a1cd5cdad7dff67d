"""The path of a measured orientation: its quaternions, and how far it has turned about its own axes since it began.

    turn_0 = 0,   turn_i = turn_{i-1} + log(q_{i-1}^-1 q_i),   between rows at the fraction s:  q_{i-1} exp(s log(...))

For small steps the turn's slope is the angular velocity in the body's axes, so that what smooths a hinge's angle
smooths it too; sensor noise e_i enters it once, and again times a step's angle. It grows without bound while a body
tumbles and is no coordinate of orientations; beside the path,

    turn(t) + log(q(t)^-1 p)

is one for orientations p within half a turn of q(t). A body that turns by more than half a turn from one measured row
to the next cannot be followed: the shorter way round is taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.identification.data.coordinates import Rotation, renamed
from onlinebayes.identification.data.rotations import exponential, inverse, logarithm, product
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.measurements.quaternions import normalised
from onlinebayes.runs import BadInput


@dataclass(frozen=True)
class OrientationPath:
    """One joint's measured orientation in one run.

    Args:
        rows: the rows of the run that measure it.
        time: their instants [s].
        quaternion: (w, x, y, z), of norm 1.
        turn: since the first of them, in the body's axes [rad].
    """

    rows: Int[Tensor, " N"]
    time: Float[Tensor, " N"]
    quaternion: Float[Tensor, "N 4"]
    turn: Float[Tensor, "N 3"]

    def at(self, instants: Float[Tensor, " T"]) -> tuple[Float[Tensor, "T 4"], Float[Tensor, "T 3"]]:
        """Quaternion and turn at these instants [s]; before the first row and after the last one those of that row."""
        after = torch.searchsorted(self.time, instants).clamp(1, len(self.time) - 1)
        before = after - 1
        share = ((instants - self.time[before]) / (self.time[after] - self.time[before])).clamp(0, 1)[:, None]
        step = share * (self.turn[after] - self.turn[before])
        return product(self.quaternion[before], exponential(step)), self.turn[before] + step


def read_path(measurement: Measurement, run: str, rotation: Rotation) -> OrientationPath:
    """The path of one joint in one run.

    Raises:
        BadInput: a run without two measured orientations, only some parts of one, or a norm that is not near 1.
    """
    data = measurement.data[measurement.runs.index(run)]
    names = [signal.name for signal in measurement.signals]
    if lacking := [name for name in rotation.quaternion if name not in names]:
        raise BadInput(
            f"joint '{rotation.joint}' has no measured orientation",
            f"add the column{'s' if lacking[1:] else ''} {', '.join(lacking)}, or weld the body",
        )
    places = [names.index(name) for name in rotation.quaternion]
    cells = torch.where(data["measured"], data["signal"], torch.nan)[:, places].cpu().numpy().astype(np.float64)
    w, x, y, z = rotation.quaternion
    columns = dict(zip(rotation.quaternion, cells.T, strict=True))
    unit = normalised(columns, (w, x, y, z), f"run '{run}'", np.arange(1, len(cells) + 1))
    quaternion = torch.from_numpy(np.stack([unit[name] for name in rotation.quaternion], -1)).to(data["signal"])
    rows = (~torch.isnan(quaternion[:, 0])).nonzero()[:, 0]
    if len(rows) < 2:
        raise BadInput(
            f"joint '{rotation.joint}' has no measured orientation",
            f"measure {', '.join(rotation.quaternion)} in every run, or weld the body",
            where=f"run '{run}'",
        )
    return followed(rows, data["time"][rows], quaternion[rows])


def followed(rows: Int[Tensor, " N"], time: Float[Tensor, " N"], quaternion: Float[Tensor, "N 4"]) -> OrientationPath:
    """The path of unit quaternions, whatever their signs; arguments as :class:`OrientationPath`."""
    steps = logarithm(product(inverse(quaternion[:-1]), quaternion[1:]))
    return OrientationPath(rows, time, quaternion, torch.cat([torch.zeros_like(steps[:1]), steps.cumsum(0)]))


def unrolled(measurement: Measurement, rotation: Rotation, paths: Sequence[OrientationPath]) -> Measurement:
    """The measurement with one joint's turns where its quaternion stood first."""
    given = {signal.name: signal for signal in measurement.signals}
    names = renamed(tuple(given), (rotation,))
    signals = tuple(given[name] if name in given else _turn_signal(name, rotation, given) for name in names)
    value, measured = measurement.data["signal"], measurement.data["measured"]
    columns = {name: (value[..., s], measured[..., s]) for s, name in enumerate(given)}
    for axis, name in enumerate(rotation.turns):
        turn, known = torch.zeros_like(value[..., 0]), torch.zeros_like(measured[..., 0])
        for r, one in enumerate(paths):
            turn[r, one.rows], known[r, one.rows] = one.turn[:, axis], True
        columns[name] = turn, known
    data = measurement.data.clone(recurse=False)
    data["signal"] = torch.stack([columns[name][0] for name in names], -1)
    data["measured"] = torch.stack([columns[name][1] for name in names], -1)
    return replace(measurement, data=data, signals=signals)


def _turn_signal(name: str, rotation: Rotation, given: Mapping[str, Signal]) -> Signal:
    """A small turn moves a unit quaternion by half of it, so that a turn is twice as noisy as the parts on average."""

    def doubled(sizes: list[float | None]) -> float | None:
        known = [size for size in sizes if size is not None]
        return 2 * (sum(size**2 for size in known) / 4) ** 0.5 if len(known) == 4 else None

    parts = [given[part] for part in rotation.quaternion]
    return Signal(name, "rad", doubled([part.sd for part in parts]), doubled([part.resolution for part in parts]))
