"""Whether a log lost the rows that it seems to lack, or has none there: which reading of the commands fits better.

    lost:  commands go on a straight line from row to row        (a logger that dropped what it could not keep up with)
    held:  commands are held until the next row that there is    (a logger that writes when something happens)

The contract of measurement tables says held; most loggers lose rows. Under the wrong reading commands come half of a
gap late, or early, which passes for a delay.
"""

from __future__ import annotations

from dataclasses import replace

import torch

from onlinebayes.identification.data.lost_rows import lost
from onlinebayes.identification.fitting.numerics import settled_misfit
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.identifiable import Identifiable


def rows_missing(measurement: Measurement) -> int:
    """How many rows seem to be missing across which a command changes."""
    count = 0
    for r, length in enumerate(measurement.lengths.tolist()):
        data = measurement.data[r, :length]
        missing = lost(data["time"], data["measured"].any(-1))
        changes = (data["command"].diff(dim=0) != 0).any(-1)
        count += int(torch.where(changes, missing, 0).sum())
    return count


def held_over_gaps(simulator: Identifiable, fit_runs: Measurement, horizon: float) -> bool:
    """Whether the base model follows the log better where commands are held through the rows that it lacks.

    Args:
        simulator: the base model.
        fit_runs: the runs that it is fitted to.
        horizon: H [s].
    """
    if not rows_missing(fit_runs):
        return False
    line, held = (settled_misfit(simulator, replace(fit_runs, held_over_gaps=one), horizon) for one in (False, True))
    return held < line
