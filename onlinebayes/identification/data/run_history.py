"""A run's motion and commands before any of its windows, from which the effects' hidden states are integrated.

    knots t_k, half a half-window apart:   (q_k, v_k) of the smoother's local cubic
    between two of them:                   Hermite's cubic through both; a straight line where knots between are missing

Read in the middle of each row of the replay, over which the command is held. Over a gap of the log commands go straight
from the last one before it to the first one after it: nobody knows them, and a servo's goal goes with its motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.identification.data.grid import RunGrid, row_step, run_grids
from onlinebayes.identification.data.motion import SeenBy, seen_by
from onlinebayes.identification.data.smoother import half_window, local_cubic
from onlinebayes.measurements import Measurement


@dataclass(frozen=True)
class RunHistory:
    """One run of G rows and J joints, smoothed when it is asked for.

    Args:
        measurement: that the run belongs to.
        grid: the run on the rows of the replay.
        joints: names, each with its position or its velocity among the signals.
    """

    measurement: Measurement
    grid: RunGrid
    joints: tuple[str, ...]

    @cached_property
    def command(self) -> Float[Tensor, "G1 U"]:
        """Commands at all rows [command units], on a straight line over each gap."""
        return _bridged(self.grid)

    @cached_property
    def motion(self) -> TensorDict | None:
        """Batch size (G,): ``"q"`` and ``"v"`` (G, J) [SI], ``"command"`` and ``"enable"`` (G, U).

        None where a joint was measured too seldom to say how it moved.
        """
        grid, rows = self.grid, max(self.grid.rows, 1)
        alone = self.measurement.select([grid.name])
        (sensor,) = run_grids(alone, row_step(alone))
        names = [signal.name for signal in alone.signals]
        at = (torch.arange(rows).to(grid.value) + 0.5) * grid.step
        found = [_path(sensor, seen_by(joint, names), at) for joint in self.joints]
        if any(path is None for path in found):
            return None
        q, v = (torch.stack(part, dim=-1) for part in zip(*(path for path in found if path is not None), strict=True))
        columns = {"q": q, "v": v, "command": self.command[:rows], "enable": grid.enable[:rows]}
        return TensorDict(columns, batch_size=[rows])


def _path(
    sensor: RunGrid, by: SeenBy, at: Float[Tensor, " G"]
) -> tuple[Float[Tensor, " G"], Float[Tensor, " G"]] | None:
    """Position and velocity of a joint; of one whose velocity alone was measured, the position is that integrated."""
    path = smoothed(sensor, by.column, at)
    if path is None or by.position:
        return path
    v, step = path[0], 2 * float(at[0])  # the instants are the rows' middles
    return step * (v.cumsum(0) - v / 2), v


def smoothed(
    sensor: RunGrid, signal: int, at: Float[Tensor, " G"]
) -> tuple[Float[Tensor, " G"], Float[Tensor, " G"]] | None:
    """A signal and its rate at the instants ``at`` [s]; None with fewer than two places where the smoother sees enough.

    Args:
        sensor: the run on its sensor's rows.
        signal: its column.
        at: instants since the run began [s].
    """
    m = half_window((sensor,), signal)
    end, spacing = sensor.rows * sensor.step, max(1, m // 2) * sensor.step
    knots = torch.linspace(0.0, end, math.ceil(end / spacing) + 1).to(at)
    value, sd, _, _ = local_cubic(sensor.value[:, signal], sensor.observed[:, signal], knots, m, sensor.step)
    known = torch.isfinite(sd).all(-1)
    if int(known.sum()) < 2:
        return None
    return _hermite(knots[known], value[known], at, 1.5 * spacing)


def _bridged(grid: RunGrid) -> Float[Tensor, "G1 U"]:
    """Commands, on a straight line over each gap."""
    command = grid.command.clone()
    for before, after in grid.pauses:
        part = torch.linspace(0.0, 1.0, after - before + 1).to(command)[:, None]
        command[before : after + 1] = (1 - part) * command[before] + part * command[after]
    return command


def _hermite(
    knots: Float[Tensor, " K"], value: Float[Tensor, "K 2"], at: Float[Tensor, " G"], longest: float
) -> tuple[Float[Tensor, " G"], Float[Tensor, " G"]]:
    """Position and velocity between knots; on a straight line where two are further apart than ``longest`` [s]."""
    after = torch.searchsorted(knots, at).clamp(1, len(knots) - 1)
    (q0, v0), (q1, v1) = value[after - 1].unbind(-1), value[after].unbind(-1)
    width = knots[after] - knots[after - 1]
    slope = (q1 - q0) / width
    v0, v1 = torch.where(width > longest, slope, v0), torch.where(width > longest, slope, v1)
    s = ((at - knots[after - 1]) / width).clamp(0.0, 1.0)
    bent, over = v0 + v1 - 2 * slope, 3 * slope - 2 * v0 - v1
    q = q0 + width * s * (v0 + s * (over + s * bent))
    return q, v0 + s * (2 * over + 3 * s * bent)
