"""Which windows count where one of the joints was not measured for a while."""

from __future__ import annotations

import numpy as np
import pytest

from onlinebayes.identification.data.grid import row_step, run_grids
from onlinebayes.identification.data.tiling import Tiling, tile
from onlinebayes.measurements import Measurement

T = np.arange(0.0, 6.001, 0.01)


def tiling(elbow: np.ndarray, hip: np.ndarray | None = None) -> Tiling:
    """Windows of a second of one run whose hip was measured in every row, unless another is given."""
    run = {"time": T, "ctrl.motor": 0 * T, "qpos.hip": np.sin(3 * T) if hip is None else hip, "qpos.elbow": elbow}
    measurement = Measurement.from_runs({"swing": run})
    return tile(measurement, run_grids(measurement, row_step(measurement)), ("hip", "elbow"), 1.0)


def swing(*hole: float) -> np.ndarray:
    begin, end = hole or (9.0, 9.0)
    return np.where((begin < T) & (end > T), np.nan, np.cos(5 * T))


@pytest.mark.parametrize(
    ("hole", "starts"),
    [
        ((), [0, 100, 200, 300, 400, 500]),
        ((2.0, 4.0), [0, 100, 400, 500]),
        ((2.0, 3.3), [0, 100, 300, 400, 500]),
        ((2.2, 2.6), [0, 100, 200, 300, 400, 500]),
        ((2.2, 2.9), [0, 100, 300, 400, 500]),
        ((5.4, 7.0), [0, 100, 200, 300, 400]),
    ],
)
def test_a_window_needs_every_joint_for_half_of_it(hole: tuple[float, ...], starts: list[int]) -> None:
    """One that nobody measured would rest at 0, or where it was last seen, and the others move beside it."""
    made = tiling(swing(*hole))
    assert [first for _, first in made.places] == starts
    assert bool(made.free.all())
    off = made.start[:, 1].numpy() - np.cos(0.05 * np.array(starts))
    assert (np.abs(off) < 3 * made.start_sd[:, 1].numpy() + 1e-3).all()


def test_a_signal_that_is_slower_than_any_window_is_taken_as_it_is() -> None:
    slow = np.where(np.arange(len(T)) % 150 == 0, np.cos(5 * T), np.nan)
    assert len(tiling(slow).places) == 6


def test_where_nothing_was_measured_no_joint_moves_beside_another() -> None:
    """Cameras lose all of a body at once: what they saw of it is compared."""
    assert [first for _, first in tiling(swing(2.2, 2.9), swing(2.2, 2.9)).places] == [0, 100, 200, 300, 400, 500]
