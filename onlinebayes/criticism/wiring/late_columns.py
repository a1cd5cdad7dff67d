"""One joint's signals that were logged some rows late, found by replays before any effect is tried.

    s(j, k) = error of the replay with joint j's signals put back by k rows, over that of the table as it stands
    r(k)^2  = r^2 + c^2 (k - d)^2       RMS fitted at k - 1, k and k + 1 rows; d, the delay [rows], is where it is least

The joint with the least s is looked at where that is below 0.8, at the rows for which r is least. The log is late by
whole rows, a sensor by any time, and a motor as late as that may explain as much: it is the log's where d is whole to a
twentieth of a row and no delay of an actuator fits as well. Another joint must have been on time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.candidates.candidates import can_have
from onlinebayes.criticism.wiring.bench import Bench, replay_rms, total
from onlinebayes.criticism.wiring.faults import AsItStands
from onlinebayes.criticism.wiring.shifts import FEWEST_ROWS, WHOLE, Shifted, late_joints
from onlinebayes.criticism.wiring.wiring import EQUAL_ERROR_RATIO, SCREENED_SHARE
from onlinebayes.identification.data.windows import MEMORY, make_windows
from onlinebayes.identification.fitting.fit import fit
from onlinebayes.identification.fitting.projection import signal_rms
from onlinebayes.identification.replaying.charted import orientation_paths
from onlinebayes.parameters import Parameter
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import ActuatorDelay

LONGEST = 2.0  # times the delay that is tried: a motor's bound
RUNS = 4  # times the delay: what the shortest run must last

Lead = tuple[Shifted, Float[Tensor, " P"]]
"""A late column, and the theta that suits it best."""


def late_column(bench: Bench) -> Lead | None:
    """The late column that the table speaks for, if it does.

    Args:
        bench: the base model and the table as it stands.
    """
    screened = _screened(bench)
    lead = None if screened is None else _walked(bench, *screened)
    return lead if lead is not None and lead[0].rows >= FEWEST_ROWS else None


def is_the_logs(bench: Bench, fault: Shifted, theta: Float[Tensor, " P"]) -> bool:
    """Whether it is the log that is late: by whole rows, and no motor by as much instead.

    Args:
        bench: on a rung on which the numerics do not matter.
        fault: a late column that leaves nothing but noise.
        theta: of the model fitted to the table put right [SI].
    """
    nearby = [bench.refitted(replace(fault, rows=fault.rows + k), theta) for k in (-1, 0, 1)]
    errors = [found[0] for found in nearby if found is not None]
    if len(errors) < len(nearby):
        return False
    before, here, after = (error**2 for error in errors)
    curvature = before + after - 2 * here
    off = 0.5 * (before - after) / curvature if curvature > 0 else math.inf
    return abs(off) <= WHOLE and not _motor_as_late(bench, fault, theta, errors[1])


def _screened(bench: Bench) -> Lead | None:
    """The joint and about the rows."""
    if orientation_paths(bench.simulator)[0]:  # an orientation's columns cannot be put back one by one
        return None
    thetas = bench.thetas()
    own = bench.screened(AsItStands(), thetas).amin(1, keepdim=True)
    least, found = SCREENED_SHARE, None
    for fault in late_joints(bench.measurement):
        shares = (bench.screened(fault, thetas) / own).nan_to_num(math.inf)
        if float(shares.min()) < least:
            least, found = float(shares.min()), (fault, thetas[int(shares.argmin()) % len(thetas)])
    return found


def _walked(bench: Bench, fault: Shifted, theta: Float[Tensor, " P"]) -> Lead:
    """From row to row until neither neighbour fits better, each fit begun where the best one so far ended."""
    most = int(bench.measurement.lengths.min()) // RUNS
    errors: dict[int, float] = {}

    def error(rows: int) -> float:
        nonlocal theta
        if rows not in errors:
            found = bench.refitted(replace(fault, rows=rows), theta) if 1 <= rows <= most else None
            if found is not None and found[0] < min(errors.values(), default=math.inf):
                theta = found[1]
            errors[rows] = math.inf if found is None else found[0]
        return errors[rows]

    return replace(fault, rows=_descended(fault.rows, error)), theta


def _descended(rows: int, error: Callable[[int], float]) -> int:
    """The number of rows from which a step either way is no better."""
    while True:
        better = min((rows, rows - 1, rows + 1), key=error)
        if better == rows:
            return rows
        rows = better


def _motor_as_late(bench: Bench, fault: Shifted, theta: Float[Tensor, " P"], error: float) -> bool:
    """Whether the delay of an actuator fits as well as the late column does: of that whose replay comes closest."""
    windows = make_windows(
        bench.coarse, bench.measurement, bench.horizon, MEMORY * bench.horizon, bench.base.windows.noise
    )
    bounds = Parameter(0.0, LONGEST * fault.seconds, "s")
    delays = [
        effect for name in bench.simulator.commands if can_have(bench.coarse, effect := ActuatorDelay(name, bounds))
    ]
    if not delays:
        return False
    models = [bench.coarse.with_effect(effect) for effect in delays]
    begin = torch.cat([theta, theta.new_full((len(models[0].parameters) - len(theta),), fault.seconds)])
    replayed = [float(replay_rms(model, windows, begin[None], windows.noise).mean()) for model in models]
    try:
        fitted = fit(models[replayed.index(min(replayed))], windows, begin)
    except BadInput:  # it diverges
        return False
    return total(signal_rms(fitted.projected)) <= EQUAL_ERROR_RATIO * error
