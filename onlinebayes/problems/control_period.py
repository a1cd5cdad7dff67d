"""The time for which a log's controller held a command: how long an action lasts where a policy takes its place.

    the tenth percentile of the times between changes of a command;   at least a row of the log, at most LONGEST

Rows may come more often than commands. Commands that were held for a second each to excite a machine say nothing of the
controller: above LONGEST a row is taken.
"""

from __future__ import annotations

import torch

from onlinebayes.identification import row_step
from onlinebayes.measurements import Measurement

SHORTEST_SHARE = 0.1
"""Of the times between changes, the part that may be shorter: a clock jitters."""

LONGEST = 0.1
"""Of a controller that is taken for one [s]."""


def control_period(measurement: Measurement) -> float:
    """Seconds for which a command was held [s].

    Args:
        measurement: the log.
    """
    data, row = measurement.data, row_step(measurement)
    held = []
    for time, mask, command in zip(data["time"], data["mask"], data["command"], strict=True):
        instants, u = time[mask], command[mask]
        held.append(instants[1:][(u[1:] != u[:-1]).any(-1)].diff())
    times = torch.cat(held)
    if not len(times):
        return row
    shortest = float(times.double().quantile(SHORTEST_SHARE))
    return shortest if row < shortest <= LONGEST else row
