"""Commands in rows that a log lost: a straight line where the command goes smoothly, unknown where it jumps.

    u_{i+k} = u_i + k / (m + 1) (u_{i+1} - u_i),   k = 1 .. m      m rows lost between rows i and i + 1 of the table
    jump:   abs(u_{i+1} - u_i) > 5 (m + 1) median_j abs(u_{j+1} - u_j),  and more than a fifth of the command's range

Held over the gap, as between rows of an even clock, a smooth command comes late by half of the gap, which hides what is
missing. Of a jump nobody knows in which of the lost rows it was; there the run is parted, as at a pause. But a log that
was written when something changed has lost nothing where it has no row, and its command was held: which of the two a
log is, criticism asks of the log (its ``wiring.readings``).
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from onlinebayes.measurements import Measurement

LEAST_GAP = 0.7
"""Rows further apart than the median step by more than this part of it may have lost some between them."""

GAP_JITTERS = 4.0
"""And by more than so many median deviations of the steps: of instants that jitter evenly none is."""

JUMP_ROWS = 5.0
"""A change across a gap is a jump from so many times the usual change of its rows on."""

JUMP_SHARE = 0.2
"""And from this share of the command's range on: what is less moves the machine by little."""


def lost(time: Float[Tensor, " T"], measures: Bool[Tensor, " T"]) -> Int[Tensor, " T_1"]:
    """Number of rows lost between each row and the next; 0 nearly everywhere.

    Args:
        time: of a run's rows [s].
        measures: which of them measure any signal. A row without has commands with instants of their own: what came
            before is held until then.
    """
    apart = time.diff()
    if not len(apart):
        return apart.long()
    steps = apart / apart.median().clamp_min(1e-300)
    threshold = 1 + max(LEAST_GAP, GAP_JITTERS * float((steps - 1).abs().median()))
    gap = (steps > threshold) & measures[:-1] & measures[1:]
    return torch.where(gap, steps.round().long() - 1, 0)


def jumps(
    command: Float[Tensor, "T U"], missing: Int[Tensor, " T_1"], everywhere: bool = False
) -> Bool[Tensor, " T_1"]:
    """Between which rows a command jumps at an unknown instant: where rows are lost, or between any two rows."""
    change = command.diff(dim=0).abs()
    whole = missing == 0
    unknown = whole | True if everywhere else ~whole
    if not bool(unknown.any()) or not bool(whole.any()):
        return unknown & False
    usual = change[whole].median(0).values
    spread = command.amax(0) - command.amin(0)
    large = (change > JUMP_ROWS * (missing[:, None] + 1) * usual) & (change > JUMP_SHARE * spread)
    return unknown & large.any(1)


def filled(
    time: Float[Tensor, " T"], command: Float[Tensor, "T U"], missing: Int[Tensor, " T_1"]
) -> tuple[Float[Tensor, " N"], Float[Tensor, "N U"]]:
    """The rows' times and commands, with those that were lost on a straight line between their neighbours."""
    if not bool(missing.any()):
        return time, command
    parts = missing + 1
    row = torch.arange(len(parts), device=time.device).repeat_interleave(parts)
    first = torch.cat([parts.new_zeros(1), parts.cumsum(0)[:-1]])
    share = (torch.arange(len(row), device=time.device) - first[row]).to(time) / parts[row]
    at = time[row] + share * (time[row + 1] - time[row])
    between = command[row] + share[:, None] * (command[row + 1] - command[row])
    return torch.cat([at, time[-1:]]), torch.cat([between, command[-1:]])


def rows_missing(measurement: Measurement) -> int:
    """Count the rows that seem to be missing across which a command changes."""
    count = 0
    for r, length in enumerate(measurement.lengths.tolist()):
        data = measurement.data[r, :length]
        missing = lost(data["time"], data["measured"].any(-1))
        changes = (data["command"].diff(dim=0) != 0).any(-1)
        count += int(torch.where(changes, missing, 0).sum())
    return count
