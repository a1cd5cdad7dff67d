"""The places of the windows in the runs, their numbers of rows and bins, and their starts.

window w: rows g_w .. g_w + K of run r_w, K rows in bins of at most H / 100, one after the other without overlap

No window bridges a gap of the log: each stretch between gaps is tiled by itself. A window is left out where one of
the joints, though its signal is not that slow, was not measured for more than half of it while others were: where it
was nobody knows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.identification.data.grid import RunGrid, row_step, run_grids
from onlinebayes.identification.data.motion import seen_by
from onlinebayes.identification.data.noise import noise_floors
from onlinebayes.identification.data.smoother import half_window
from onlinebayes.identification.data.starts import window_starts
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput

BINS = 100


@dataclass(frozen=True)
class Tiling:
    """W windows of K rows.

    Args:
        places: run and grid row at which each window starts.
        rows, bin_rows: K, and the rows averaged into one bin, which divide it.
        start, start_sd: (q0 of the J joints, v0 of the J joints) and their sd [SI].
        free: which joints move in the window.
        noise: floor of each signal [SI].
    """

    places: tuple[tuple[int, int], ...]
    rows: int
    bin_rows: int
    start: Float[Tensor, "W J2"]
    start_sd: Float[Tensor, "W J2"]
    free: Bool[Tensor, "W J"]
    noise: Float[Tensor, " S"]


def tile(
    measurement: Measurement,
    grids: tuple[RunGrid, ...],
    joints: tuple[str, ...],
    horizon: float,
    noise: Float[Tensor, " S"] | None = None,
    inset: bool = False,
    memory_span: float = 0.0,
) -> Tiling:
    """Tile every run and smooth the windows' starts on the sensor's own rows.

    Args:
        measurement: the runs.
        grids: the same on the even clock of the replay.
        joints: the simulator's, each with a position or a velocity among the signals.
        horizon: H [s]; shortened to the longest stretch without a gap.
        noise: floor of each signal [SI], or None to take it from these runs.
        inset: begin where the smoother sees the start from both sides.
        memory_span: no window begins earlier than that in a stretch [s], as far as the stretch can spare it.

    Raises:
        BadInput: every run is too short for a single window.
    """
    sensor, step = run_grids(measurement, row_step(measurement)), grids[0].step
    names = [signal.name for signal in measurement.signals]
    if noise is None:
        noise = noise_floors(measurement.signals, sensor).to(measurement.data["signal"])
    longest = max((last - first for grid in grids for first, last in grid.pieces), default=0)
    rows = min(max(4, round(horizon / step)), max(longest, 1))
    bin_rows = max(1, rows // BINS)
    rows -= rows % bin_rows
    lead = _lead(sensor, names, joints, rows * step, step) if inset else 0
    unknown = math.ceil(memory_span / step)
    places = [
        (r, first + skipped + g)
        for r, grid in enumerate(grids)
        for first, last in grid.pieces
        for skipped in [max(lead, _spared(last - first, rows, unknown))]
        for g in _starts(last - first - skipped, rows)
    ]
    # Where commands go on and sensors do not, windows would have nothing to compare; and where nothing tells where one
    # of the joints was, the others would move beside one that rests.
    seen = [[0, *grid.observed.any(-1).cumsum(0).tolist()] for grid in grids]
    places = [(r, g) for r, g in places if seen[r][min(g + rows, grids[r].rows) + 1] > seen[r][g + 1]] or places
    shown = sorted({seen_by(joint, names).column for joint in joints})
    most = [max(rows / 2, _spacing(grids, s)) for s in shown]
    whole = [bool(grid.observed[:, shown].all()) for grid in grids]
    followed = (whole[r] or _followed(grids[r].observed[g : g + rows + 1, shown], most) for r, g in places)
    places = [place for place, kept in zip(places, followed, strict=True) if kept] or places
    if not places:
        raise BadInput(
            f"the longest run has {longest} steps of {step:g} s, too few to compare anything",
            "record longer runs; a run lasts from its first row to its last",
        )
    cuts = [(r, g * step, (g + rows) * step) for r, g in places]
    return Tiling(tuple(places), rows, bin_rows, *window_starts(sensor, cuts, names, joints, noise), noise)


def _followed(observed: Bool[Tensor, "K1 J"], most: Sequence[float]) -> bool:
    """Check whether no joint of a window is unmeasured for more than so many rows in which another one is measured."""
    observed = observed[observed.any(-1)]
    ends = observed.new_ones(1)
    for column, rows in zip(observed.unbind(-1), most, strict=True):
        at = torch.cat([ends, column, ends]).nonzero()[:, 0]
        if int(at.diff().max() - 1) > rows:
            return False
    return True


def _spacing(grids: Sequence[RunGrid], signal: int) -> float:
    """Rows from one measured cell of a signal to the next, as a rule; 0 where that is not known."""
    steps = torch.cat([grid.observed[:, signal].nonzero()[:, 0].diff() for grid in grids])
    return float(steps.median()) if len(steps) else 0.0


def _lead(grids: tuple[RunGrid, ...], names: list[str], joints: tuple[str, ...], horizon: float, step: float) -> int:
    """Rows before the first window of a run: the smoother's half-window, where the shortest run can spare it."""
    half = max((half_window(grids, seen_by(joint, names).column) for joint in joints), default=0)
    rows = round(half * grids[0].step / step)
    spare = min(grid.rows for grid in grids) * grids[0].step - 0.5 * horizon
    return rows if rows * step <= min(0.2 * horizon, spare) else 0


def _spared(available: int, rows: int, wanted: int) -> int:
    """Rows that a stretch can do without: half of it at most, and half a window stays."""
    return max(0, min(wanted, available // 2, available - math.ceil(rows / 2)))


def _starts(available: int, rows: int) -> list[int]:
    """Starting rows of the windows of one stretch; a last one that is at least half full counts."""
    full = list(range(0, available - rows + 1, rows))
    rest = available - len(full) * rows
    return full + ([len(full) * rows] if rest >= max(2, rows / 2) else [])
