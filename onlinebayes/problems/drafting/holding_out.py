"""The runs of a log that are held out: a third, the last ones of each kind of motion, at least one of which stays.

    size, speed     standard deviations over a run of each command and signal, and of their change per second
    one kind        names that differ by numbers alone;  all sizes and speeds within a factor of 2, of one run of the
                    kind or another

Where every run is of a kind of its own, those are held out that lie within the sizes and speeds of the others.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.sparse.csgraph import connected_components

from onlinebayes.identification import FEWEST_BLOCKS
from onlinebayes.measurements import Measurement

FACTOR = 2.0
"""Ratio of the sizes or speeds of two runs from which on they are of two kinds."""
SMALLEST = 0.03
"""Share of the largest size or speed of all runs below which it counts as none."""
NUMBER = re.compile(r"[\W_]*\d+")


def held_out(runs: Sequence[str], measurement: Measurement | None = None) -> list[str]:
    """Names of the runs to hold out, in the order of the log; none of a single run.

    Args:
        runs: names, in the order of the log.
        measurement: what was commanded and measured in them; None where that cannot be read yet.
    """
    known = measurement is not None and {*runs} <= {*measurement.runs}
    motions = _motions(measurement, runs) if measurement is not None and known else np.zeros((len(runs), 0))
    costs = [_cost(run, members, motions) for members in _kinds(runs, motions) for run in members]
    return [runs[run] for run in sorted(run for *_, run in sorted(costs)[: _count(len(runs))])]


def _count(runs: int) -> int:
    """Number of runs held out: a third, or fewer that leave enough to be blocks of their own."""
    third = max(1, runs // 3) if runs > 1 else 0
    return min(third, runs - FEWEST_BLOCKS) if runs > FEWEST_BLOCKS else third


def _cost(run: int, kind: Sequence[int], motions: Float[np.ndarray, "R F"]) -> tuple[bool, float, float, int, int]:
    """Order in which runs are held out: of each kind as large a share; the first of a kind last, if amid the others."""
    first = run == kind[0]
    over = 0.0
    if first and motions.size and len(motions) > 1:
        others = np.delete(motions, run, axis=0)
        over = float(np.maximum(motions[run] - others.max(0), others.min(0) - motions[run]).clip(0).sum())
    share = sum(other >= run for other in kind) / len(kind)
    return first, over, share, -run, run


def _kinds(runs: Sequence[str], motions: Float[np.ndarray, "R F"]) -> list[list[int]]:
    """The runs of every kind: chains of runs alike."""
    stems = np.array([NUMBER.sub("", run) for run in runs])
    near = stems[:, None] == stems[None]
    for feature in motions.T:
        near &= np.abs(feature[:, None] - feature[None]) <= np.log(FACTOR)
    count, kinds = connected_components(near, directed=False)
    return [np.flatnonzero(kinds == kind).tolist() for kind in range(count)]


def _motions(measurement: Measurement, runs: Sequence[str]) -> Float[np.ndarray, "R F"]:
    """Logarithms of size and speed of every command and signal in every run."""
    found = []
    for run in runs:
        rows = measurement.data[measurement.runs.index(run)]
        rows = rows[rows["mask"]]
        time = rows["time"].cpu().numpy()
        columns = [(time, column) for column in rows["command"].cpu().numpy().T]
        measured = rows["measured"].cpu().numpy().T
        columns += [(time[k], column[k]) for k, column in zip(measured, rows["signal"].cpu().numpy().T, strict=True)]
        found.append([number for clock, column in columns for number in _size_and_speed(clock, column)])
    motions = np.array(found)
    return np.log(np.maximum(motions, SMALLEST * motions.max(0)) + np.finfo(float).tiny)


def _size_and_speed(time: Float[np.ndarray, " T"], values: Float[np.ndarray, " T"]) -> tuple[float, float]:
    if len(values) < 2:
        return 0.0, 0.0
    return float(values.std()), float((np.diff(values) / np.diff(time)).std())
