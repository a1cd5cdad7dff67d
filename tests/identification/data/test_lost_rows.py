"""Rows that a log lost: smooth commands go on, jumps part the run, and what is no lost row is left alone."""

import numpy as np
import pytest
import torch

from onlinebayes.identification.data.grid import run_grids
from onlinebayes.identification.data.lost_rows import filled, jumps, lost
from onlinebayes.measurements import Measurement

EVERY = np.arange(400) * 0.01
SMOOTH = np.sin(4 * EVERY)
STEPPED = np.where(EVERY < 2.0, 0.0, 1.0)


def table(kept: np.ndarray, command: np.ndarray) -> Measurement:
    run = {"time": EVERY[kept], "ctrl.motor": command[kept], "qpos.rail": np.sin(EVERY)[kept]}
    return Measurement.from_runs({"run": run})


def without(*rows: int) -> np.ndarray:
    return np.setdiff1d(np.arange(400), rows)


def test_a_smooth_command_goes_on_through_lost_rows() -> None:
    (grid,) = run_grids(table(without(50, 120, 121, 122), SMOOTH), 0.01)
    error = (grid.command[:-1, 0] - torch.from_numpy(SMOOTH[:-1])).abs()
    assert float(error.max()) < 5e-3  # held it is 0.12
    assert len(grid.pieces) == 1


def test_a_jump_in_a_lost_row_parts_the_run_there() -> None:
    (grid,) = run_grids(table(without(50, 200), STEPPED), 0.01)
    assert grid.pieces == ((0, 199), (201, 399))
    (whole,) = run_grids(table(without(50, 150), STEPPED), 0.01)
    assert len(whole.pieces) == 1


def test_a_small_change_in_a_lost_row_does_not() -> None:
    command = STEPPED + 0.1 * (EVERY > 1.0)
    (grid,) = run_grids(table(without(101), command), 0.01)
    assert len(grid.pieces) == 1


@pytest.mark.parametrize("jitter", [0.1, 0.3, 0.5])
def test_a_clock_that_jitters_has_lost_nothing(jitter: float) -> None:
    draw = np.random.default_rng(3)
    time = torch.from_numpy(np.arange(2000) + draw.uniform(-jitter, jitter, 2000))
    assert not bool(lost(time, torch.ones(2000, dtype=torch.bool)).any())


def test_commands_at_instants_of_their_own_are_held() -> None:
    # A signal every 20 ms, a command 1 ms before the next one: it holds until then.
    time = torch.arange(100).repeat_interleave(2) * 0.02 + torch.tensor([0.0, 0.019]).repeat(100)
    measures = torch.tensor([True, False]).repeat(100)
    assert not bool(lost(time.double(), measures).any())


def test_each_lost_row_is_counted_and_filled() -> None:
    time = torch.tensor([0.0, 1.0, 2.0, 5.0, 6.0]).double()
    missing = lost(time, torch.ones(5, dtype=torch.bool))
    assert missing.tolist() == [0, 0, 2, 0]
    at, command = filled(time, time[:, None] * torch.tensor([2.0, -1.0]).double(), missing)
    assert at.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert torch.allclose(command, at[:, None] * torch.tensor([2.0, -1.0]).double())
    assert not bool(jumps(time[:, None], missing).any())


def test_a_run_of_one_row_or_of_gaps_alone_is_left_alone() -> None:
    one = torch.zeros(1).double()
    assert lost(one, torch.ones(1, dtype=torch.bool)).tolist() == []
    assert filled(one, one[:, None], lost(one, torch.ones(1, dtype=torch.bool)))[0].tolist() == [0.0]
