"""Commands on a curve through the rows: what was smooth is followed within the rows, what jumps parts the run."""

from dataclasses import replace

import numpy as np
import torch

from onlinebayes.identification.data.between_rows import PARTS, curve_through
from onlinebayes.identification.data.grid import replay_step, run_grids
from onlinebayes.measurements import Measurement

TIME = np.arange(200) * 0.02


def table(command: np.ndarray) -> Measurement:
    run = {"time": TIME, "ctrl.motor": command, "qpos.rail": np.sin(TIME)}
    return replace(Measurement.from_runs({"run": run}), between_rows="curve")


def test_a_sine_is_followed_within_the_rows() -> None:
    command = torch.from_numpy(np.sin(12 * TIME))[:, None]
    at, along = curve_through(torch.from_numpy(TIME), command, torch.zeros(199, dtype=torch.bool))
    middle = at[:-1] + 0.01 / PARTS
    error = (along[:-1, 0] - torch.sin(12 * middle)).abs()
    assert float(error[PARTS:-PARTS].max()) < 2e-3  # a straight line: 7e-3, held: 0.24
    assert float(error.max()) < 1e-2  # at the ends of the run nothing says how it bends


def test_of_a_jump_nothing_is_smeared_into_the_rows_beside_it() -> None:
    command = torch.from_numpy(np.where(TIME < 2.0, 0.0, 1.0))[:, None]
    jumps = command.diff(dim=0)[:, 0] != 0
    _, along = curve_through(torch.from_numpy(TIME), command, jumps)
    assert sorted(along.unique().tolist()) == [0.0, 1.0]


def test_a_jump_parts_the_run_in_the_row_in_which_it_was() -> None:
    (grid,) = run_grids(table(np.where(TIME < 2.0, np.sin(TIME), 3.0)), 0.02)
    assert grid.pieces == ((0, 99), (100, 199))
    (smooth,) = run_grids(table(np.sin(12 * TIME)), 0.02)
    assert len(smooth.pieces) == 1


def test_the_replay_has_rows_within_those_of_the_log() -> None:
    curve = table(np.sin(12 * TIME))
    assert np.isclose(replay_step(replace(curve, between_rows="held"), 0.002), 0.02)
    for timestep, step in ((0.002, 0.004), (0.001, 0.005), (0.02, 0.02), (0.0002, 0.005)):
        assert np.isclose(replay_step(curve, timestep), step)
