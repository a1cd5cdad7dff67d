"""Wiring faults of poses: a quaternion in another order or the other way round, velocities in other axes.

| fault                | what the table holds                                   | mended                           |
|----------------------|--------------------------------------------------------|----------------------------------|
| :class:`Reread`      | (x, y, z, w) for (w, x, y, z); the world in the body's | the quaternion read so           |
| :class:`OtherAxes`   | linear velocity in the body's axes, or angular in the  | R v, R^-1 w, R as measured       |
|                      | world's                                                |                                  |

A table's own turns are those of its quaternions as they stand, so that a quaternion that is read otherwise comes with
paths of its own (see :mod:`.data.orientation_path`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.wiring.faults import Fault
from onlinebayes.identification.data.coordinates import Rotation
from onlinebayes.identification.data.orientation_path import OrientationPath, followed
from onlinebayes.identification.data.rotations import inverse, rotated
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.replaying.charted import orientation_paths, with_orientation_paths
from onlinebayes.identification.splitting import origin
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.identifiable import Identifiable

Columns = Callable[[str, Float[Tensor, " T"], Float[Tensor, "T 3"]], Float[Tensor, "T 3"]]
# What a table may hold -> where in it w, x, y, z stand, and with which sign.
READINGS = {
    "x, y, z, w for w, x, y, z": ((3, 0, 1, 2), (1.0, 1.0, 1.0, 1.0)),
    "the world as the body sees it for the body as the world does": ((0, 1, 2, 3), (1.0, -1.0, -1.0, -1.0)),
}
NEARBY = 10  # rows to either side from which a re-read path gives its turn and velocity


@dataclass(frozen=True)
class Reread(Fault):
    """A quaternion that the table holds in another way.

    Args:
        rotation: the joint.
        instead: which of :data:`READINGS` it is.
        paths: run -> the path of the quaternion read so.
    """

    rotation: Rotation
    instead: str
    paths: Mapping[str, OrientationPath] = field(compare=False, repr=False)

    @property
    def says(self) -> str:
        """``qpos.base.3 to qpos.base.6: x, y, z, w for w, x, y, z``."""
        return f"{self.rotation.quaternion[0]} to {self.rotation.quaternion[-1]}: {self.instead}"

    @property
    def lines(self) -> str:
        """``column`` or ``sign`` of its parts under [signals]."""
        names, (order, signs) = self.rotation.quaternion, READINGS[self.instead]
        columns = [(name, f'column = "{names[k]}"') for name, k in zip(names, order, strict=True) if names[k] != name]
        turned = [(name, "sign = -1") for name, sign in zip(names, signs, strict=True) if sign < 0]
        return "\n".join(f'[signals."{name}"]\n{line}' for name, line in (*columns, *turned))

    def correct(self, measurement: Measurement) -> Measurement:
        """The joint's turns along the other path."""
        return _with_columns(
            measurement, self.rotation.turns, lambda run, time, old: self.paths[origin(run)].at(time)[1]
        )

    def model(self, simulator: Identifiable) -> Identifiable:
        """The simulator whose turns are relative to the other path."""
        return with_orientation_paths(simulator, self.rotation.joint, self.paths)

    def started(self, windows: Windows, shown: Sequence[str]) -> Windows:
        """The joint's turns and their velocities along the other path."""
        start, J = windows.start.clone(), len(shown)
        places = torch.tensor([shown.index(name) for name in self.rotation.turns], device=start.device)
        at = start.new_tensor(windows.begin)[windows.run] + windows.first * windows.step
        for r, run in enumerate(windows.runs):
            mine = (windows.run == r).nonzero()
            turn, rate = _smoothed(self.paths[origin(run)], at[mine[:, 0]])
            start[mine, places], start[mine, J + places] = turn, rate
        return replace(windows, start=start)


@dataclass(frozen=True)
class OtherAxes(Fault):
    """Three velocities of a free or ball joint that the table holds in other axes.

    Args:
        names: the signals.
        instead: what it holds.
        backward: whether they must be turned into the body's axes; else into the world's.
        paths: run -> the measured orientation.
    """

    names: tuple[str, ...]
    instead: str
    backward: bool
    paths: Mapping[str, OrientationPath] = field(compare=False, repr=False)

    @property
    def says(self) -> str:
        """``qvel.base.3 to qvel.base.5: the world's axes for the body's``."""
        return f"{self.names[0]} to {self.names[-1]}: {self.instead}"

    @property
    def lines(self) -> str:
        """The change that the columns need: no key turns axes."""
        return f"# in the table: {', '.join(self.names)} turned into the {'body' if self.backward else 'world'}'s axes"

    def correct(self, measurement: Measurement) -> Measurement:
        """The columns in the right axes."""

        def turned(run: str, time: Float[Tensor, " T"], old: Float[Tensor, "T 3"]) -> Float[Tensor, "T 3"]:
            q, _ = self.paths[origin(run)].at(time)
            return rotated(inverse(q) if self.backward else q, old)

        return _with_columns(measurement, self.names, turned)


def conventions(simulator: Simulator, measured: set[str]) -> Iterator[Fault]:
    """Every such fault of the simulator's free and ball joints.

    Args:
        simulator: with turns in place of quaternions; others have none.
        measured: names of the signals that were measured.
    """
    turning, paths = orientation_paths(simulator)
    for b, rotation in enumerate(turning):
        mine = {run: own[b] for run, own in paths.items()}
        for instead, (order, signs) in READINGS.items():
            read = {
                run: followed(c.rows, c.time, c.quaternion[:, order] * c.quaternion.new_tensor(signs))
                for run, c in mine.items()
            }
            yield Reread(rotation, instead, read)
        linear = tuple(f"qvel.{name}" for name in rotation.linear)
        if linear and set(linear) <= measured:
            yield OtherAxes(linear, "the body's axes for the world's", False, mine)
        if set(rotation.rates) <= measured:
            yield OtherAxes(rotation.rates, "the world's axes for the body's", True, mine)


def _smoothed(path: OrientationPath, at: Float[Tensor, " V"]) -> tuple[Float[Tensor, "V 3"], Float[Tensor, "V 3"]]:
    """Turn [rad] and its velocity [rad/s] at these instants, from a cubic through the rows around each."""
    last = len(path.time) - 1
    m = min(NEARBY, last // 2)
    centre = torch.searchsorted(path.time, at).clamp(m, last - m)
    rows = centre[:, None] + torch.arange(-m, m + 1, device=at.device)
    away = path.time[rows] - at[:, None]
    width = away.abs().amax(1, keepdim=True).clamp_min(1e-9)
    powers = (away / width)[..., None] ** torch.arange(min(3, 2 * m) + 1, device=at.device)
    fitted = torch.linalg.lstsq(powers, path.turn[rows]).solution
    return fitted[:, 0], fitted[:, 1] / width


def _with_columns(measurement: Measurement, names: Sequence[str], values: Columns) -> Measurement:
    """The measurement with other values in these columns where they were measured."""
    known = [signal.name for signal in measurement.signals]
    places = [known.index(name) for name in names]
    data = measurement.data.clone(recurse=False)
    data["signal"] = data["signal"].clone()
    for r, run in enumerate(measurement.runs):
        old = data["signal"][r][:, places]
        new = values(run, data["time"][r], old)
        data["signal"][r, :, places] = torch.where(data["measured"][r][:, places], new, old)
    return replace(measurement, data=data)
