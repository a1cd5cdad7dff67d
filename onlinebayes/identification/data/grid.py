"""Runs on an even clock: what the replay is driven by and compared with, at rows g = 0 .. G of spacing h.

    u_g = 1/h int_{t_g}^{t_{g+1}} u(t) dt,      y_g = y_i + dy/dt_i (t_g - t_i),   i the nearest measured row

u(t) is the logged command, held between rows, or on a curve through them where it was sent more often
(:mod:`.between_rows`). A clock that is even already is left as it is; a jittering one is corrected to first order, and
a grid row without a measurement within h / 2 has none. A replay is not held against values that were moved so: it is
read where the sensor was, phi = (t_i - t_g) / h rows after row g (:mod:`.replaying.instants`). The average errs by
about h^2 times an acceleration's change, which was taken for a late motor: where commands change between the measured
rows, or rows jitter, the replay's own grid is finer than the sensor's (:func:`replay_step`).
Where a log pauses for more than ``PAUSE`` steps, or lost the row in which a command jumps (:mod:`.lost_rows`), nobody
knows what was commanded: the run falls into pieces there, and no window bridges them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from onlinebayes.identification.data.between_rows import curve_through
from onlinebayes.identification.data.lost_rows import filled, jumps, lost
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput

PAUSE = 10.0
"""Steps of the densest signal without any row that make a gap; a few lost rows do not."""

MOST_ROWS = 20_000_000
"""Of one run's grid: five hours at 1 kHz. A single wrong time would ask for more than there is memory."""

CLOSE = 0.2
"""Of the table's step: a jittering instant that near to a row of the grid lies on it."""

MOST = 0.95
"""Share of a signal's instants that must lie on rows of the grid before the grid is made for them."""

EXACT = 0.05
"""Of a grid's step: instants further from its rows jitter."""

FINEST = 1e-3
"""No step [s] is cut below this: what happens within it moves no machine."""

CURVE_PARTS = 4
"""Rows of the replay for one of the log, about, where commands change within it: what a constant command leaves of the
curve in a row acts by a sixteenth of what it would leave in the log's own."""

AT_ROWS = 1e-3
"""Of a grid's step: what was measured as near as that to its rows was measured there."""


@dataclass(frozen=True)
class RunGrid:
    """One run on its even clock of G + 1 rows.

    Args:
        name: the run's.
        start: instant of row 0 [s].
        step: spacing h [s].
        command: average over the interval that begins at each row [command units].
        enable: 1 while the actuator is on.
        value: signals at the rows [SI], 0 where not observed.
        observed: whether they were measured there.
        pauses: (last row before, first row after) each gap of the log.
        reading, late: the values as they were measured [SI], and how many rows after the row (-1/2 to 1/2); None where
            all were measured at rows.
    """

    name: str
    start: float
    step: float
    command: Float[Tensor, "G1 U"]
    enable: Float[Tensor, "G1 U"]
    value: Float[Tensor, "G1 S"]
    observed: Bool[Tensor, "G1 S"]
    pauses: tuple[tuple[int, int], ...] = ()
    reading: Float[Tensor, "G1 S"] | None = None
    late: Float[Tensor, "G1 S"] | None = None

    @property
    def pieces(self) -> tuple[tuple[int, int], ...]:
        """First and last row of each stretch without a gap, longer than a row."""
        first = [0, *(after for _, after in self.pauses)]
        last = [*(before for before, _ in self.pauses), self.rows]
        return tuple((a, b) for a, b in zip(first, last, strict=True) if b > a)

    @property
    def rows(self) -> int:
        """Number of intervals G."""
        return self.value.shape[0] - 1


def row_step(measurement: Measurement) -> float:
    """Median time between the rows that measure the densest signal [s]; commands may come more often."""
    data = measurement.data
    alike = _measured_together(data["measured"].flatten(0, 1))
    steps = [_median_step(data["time"], rows.view_as(data["mask"])) for rows, _ in alike]
    step = min([step for step in steps if step is not None], default=_median_step(data["time"], data["mask"]))
    if step is None:
        raise BadInput("every run has a single row", "record runs of many rows")
    return step


def _median_step(time: Float[Tensor, "R T"], rows: Bool[Tensor, "R T"]) -> float | None:
    """Median over all runs of the time between marked rows [s]; None where no run has two."""
    gaps = torch.cat([at[marked].diff() for at, marked in zip(time, rows, strict=True)])
    return float(gaps.median()) if gaps.numel() else None


def even_step(measurement: Measurement, timestep: float) -> float:
    """Spacing h [s]: the time between rows of the densest signal, as a whole number of integration steps (one or more).

    Where another signal is measured between those rows, a part of it on whose rows nearly all signals lie: a value
    that is moved to another row would be compared across a jump of the command.
    """
    return max(1, round(row_step(measurement) / _rows_apart(measurement) / timestep)) * timestep


def replay_step(measurement: Measurement, timestep: float) -> float:
    """Spacing h [s] of what a replay is driven by: as :func:`even_step`, or finer, as commands and jitter ask for.

    Where commands change between the measured rows, the time between their changes; a single timestep where more than
    a few rows, or changes, lie off an even clock of it.
    """
    measured = row_step(measurement) / _rows_apart(measurement)
    step, instants = measured, list(_measured_and_changed(measurement))
    if any(len(torch.cat([rows, changes]).unique()) > len(rows) / MOST for rows, changes in instants):
        apart = torch.cat([changes.diff() for _, changes in instants])
        step = min(step, float(apart.median()))
    if not all(_even(torch.cat(both), step) for both in instants):
        step = 0.0
    steps = max(1, round(max(step, min(FINEST, measured)) / timestep))
    return (_parted(steps, timestep) if measurement.between_rows == "curve" else steps) * timestep


def _parted(steps: int, timestep: float) -> int:
    """Timesteps of the rows in which a curve between the measured rows is followed, a whole part of theirs."""
    parts = [n for n in range(1, 2 * CURVE_PARTS) if steps % n == 0 and steps // n * timestep >= FINEST]
    return steps // min(parts, key=lambda n: abs(n - CURVE_PARTS), default=1)


def _measured_and_changed(measurement: Measurement) -> Iterator[tuple[Tensor, Tensor]]:
    """Of each run when signals were measured, and when a command took another value [s after its first row]."""
    for run in measurement.data:
        time, command = run["time"][run["mask"]], run["command"][run["mask"]]
        changed = (command[1:] != command[:-1]).any(-1)
        yield time[run["measured"][run["mask"]].any(-1)] - time[0], time[1:][changed] - time[0]


def _even(time: Float[Tensor, " N"], step: float) -> bool:
    """Check whether nearly all instants are whole multiples of a step."""
    place = time / step
    return not len(place) or float(((place - place.round()).abs() < EXACT).double().mean()) > MOST


def _rows_apart(measurement: Measurement) -> int:
    """Into how many parts the densest signal's step is cut, so that the rows of all signals are rows of the grid."""
    data = measurement.data
    table = _median_step(data["time"], data["mask"])
    if table is None or (stride := round(row_step(measurement) / table)) < 2:
        return 1
    places = [place for run in data for place in _places(run["time"][run["mask"]], run["measured"][run["mask"]], table)]
    shares = [step for step in range(stride, 0, -1) if stride % step == 0]
    return stride // next((step for step in shares if all(_lies_on(place, step) for place in places)), stride)


def _places(time: Float[Tensor, " T"], measured: Bool[Tensor, "T S"], step: float) -> list[Tensor]:
    """When each signal was measured (N_s), in steps [1] after the first row of the one that is measured most."""
    times = [time[rows] for rows in measured.unbind(-1) if bool(rows.any())]
    first = max(times, key=len)[0] if times else 0.0
    return [(at - first) / step for at in times]


def _lies_on(place: Float[Tensor, " N"], step: int) -> bool:
    """Check whether nearly all of a signal's instants are whole multiples of ``step``."""
    off = (place / step - (place / step).round()).abs() * step
    return float((off < CLOSE).double().mean()) > MOST


def run_grids(measurement: Measurement, step: float) -> tuple[RunGrid, ...]:
    """Every run of the measurement on an even clock of spacing ``step`` [s] that starts at its first row."""
    longest = PAUSE * row_step(measurement)
    return tuple(_run_grid(measurement, r, step, longest) for r in range(len(measurement.runs)))


def _run_grid(measurement: Measurement, r: int, step: float, longest: float) -> RunGrid:
    rows = int(measurement.lengths[r])
    data = measurement.data[r, :rows]
    time = data["time"] - data["time"][0]
    # A millionth of a step forgives rounding in the logged times.
    count = int(torch.floor(time[-1] / step + 1e-6))
    if count > MOST_ROWS:
        raise BadInput(
            f"run '{measurement.runs[r]}' lasts {float(time[-1]):g} s, {count} steps of {step:g} s",
            "check its times, or cut it into runs",
        )
    grid = torch.arange(count + 1, dtype=time.dtype, device=time.device) * step
    reading, slope, late, observed = _nearest(time, data["signal"], data["measured"], grid, step)
    at_rows = bool((late.abs() <= AT_ROWS).all())
    midpoint = torch.searchsorted(time, grid + 0.5 * step).clamp(1, rows) - 1
    pause = time.diff() > max(longest, 2 * step)
    missing = torch.where(pause | measurement.held_over_gaps, 0, lost(time, data["measured"].any(-1)))
    curved = measurement.between_rows == "curve"
    parted = pause | jumps(data["command"], missing, curved)
    go_on = curve_through(time, data["command"], parted) if curved else filled(time, data["command"], missing)
    return RunGrid(
        measurement.runs[r],
        float(data["time"][0]),
        step,
        _average(*go_on, grid, step),
        data["enable"][midpoint],
        reading - slope * late * step,
        observed,
        _pauses(time, parted, step, count),
        None if at_rows else reading,
        None if at_rows else late,
    )


def _pauses(
    time: Float[Tensor, " T"], parted: Bool[Tensor, " T_1"], step: float, count: int
) -> tuple[tuple[int, int], ...]:
    """(last grid row before, first after) each stretch between two rows that are ``parted``."""
    found = []
    for i in torch.nonzero(parted).flatten().tolist():
        before, after = float(time[i]) / step, float(time[i + 1]) / step
        found.append((math.floor(before + 1e-6), min(math.ceil(after - 1e-6), count)))
    return tuple(found)


def _average(
    time: Float[Tensor, " T"], command: Float[Tensor, "T U"], grid: Float[Tensor, " G1"], step: float
) -> Float[Tensor, "G1 U"]:
    """Mean of the held command over [t_g, t_g + h]."""
    end = torch.cat([time[1:], time[-1:] + max(step, 1.0)])
    integral = torch.cat([torch.zeros_like(command[:1]), ((end - time)[:, None] * command).cumsum(0)])
    edges = torch.cat([grid, grid[-1:] + step])
    row = torch.searchsorted(time, edges, right=True).clamp(1, len(time)) - 1
    at_edges = integral[row] + (edges - time[row])[:, None] * command[row]
    return (at_edges[1:] - at_edges[:-1]) / step


def _nearest(
    time: Float[Tensor, " T"],
    signal: Float[Tensor, "T S"],
    measured: Bool[Tensor, "T S"],
    grid: Float[Tensor, " G1"],
    step: float,
) -> tuple[Float[Tensor, "G1 S"], Float[Tensor, "G1 S"], Float[Tensor, "G1 S"], Bool[Tensor, "G1 S"]]:
    """Each grid row's nearest measured value, the local slope, how many rows late it was, and whether there is one."""
    reading, slopes, lateness = (signal.new_zeros(len(grid), signal.shape[1]) for _ in range(3))
    observed = measured.new_zeros(len(grid), signal.shape[1])
    for rows, columns in _measured_together(measured):
        t, y = time[rows], signal[rows][:, columns]
        if len(t) < 3:
            continue
        slope = torch.gradient(y, spacing=(t,), dim=0)[0]
        right = torch.searchsorted(t, grid).clamp(1, len(t) - 1)
        nearest = torch.where(grid - t[right - 1] < t[right] - grid, right - 1, right)
        late = (t[nearest] - grid) / step
        near = late.abs() <= 0.5001
        for part, value in ((reading, y[nearest]), (slopes, slope[nearest]), (lateness, late[:, None])):
            part[:, columns] = torch.where(near[:, None], value, torch.zeros_like(value))
        observed[:, columns] = near[:, None]
    return reading, slopes, lateness, observed


def _measured_together(measured: Bool[Tensor, "T S"]) -> Iterator[tuple[Bool[Tensor, " T"], Int[Tensor, " C"]]]:
    """Rows and columns of the signals that are measured at the same rows, group by group."""
    if not measured.numel():
        return
    groups, of = torch.unique(measured.T, dim=0, return_inverse=True)
    for k, rows in enumerate(groups):
        yield rows, (of == k).nonzero()[:, 0]
