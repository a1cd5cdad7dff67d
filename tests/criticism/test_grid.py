import numpy as np
import pytest
import torch

from onlinebayes.criticism.grid import even_step, run_grids
from onlinebayes.measurements import Measurement


def table(time: np.ndarray, command: np.ndarray, angle: np.ndarray) -> Measurement:
    return Measurement.from_runs({"run": {"time": time, "ctrl.motor": command, "qpos.rail": angle}})


def test_an_even_clock_is_left_as_it_is() -> None:
    time = 5.0 + np.arange(101) * 0.01
    command, angle = np.random.default_rng(0).normal(size=(2, 101))
    (grid,) = run_grids(table(time, command, angle), 0.01)
    assert grid.start == 5.0
    assert grid.rows == 100
    assert torch.allclose(grid.command[:-1, 0], torch.tensor(command[:-1]), atol=1e-6)
    assert torch.allclose(grid.value[:, 0], torch.tensor(angle), atol=1e-6)
    assert bool(grid.observed.all())


def test_commands_are_averaged_over_a_longer_step() -> None:
    time = np.arange(13) * 0.01
    command = np.arange(13.0)
    (grid,) = run_grids(table(time, command, np.zeros(13)), 0.03)
    assert grid.command[:4, 0].tolist() == pytest.approx([1.0, 4.0, 7.0, 10.0])


def test_a_jittering_clock_is_corrected_to_first_order() -> None:
    draw = np.random.default_rng(1)
    time = np.arange(400) * 0.01 + draw.uniform(-0.003, 0.003, 400)
    time -= time[0]
    (grid,) = run_grids(table(time, np.zeros(400), np.sin(3 * time)), 0.01)
    at = torch.arange(grid.rows + 1, dtype=torch.float64) * 0.01
    seen = grid.observed[:, 0]
    assert float(seen.double().mean()) > 0.95
    assert float((grid.value[seen, 0] - torch.sin(3 * at[seen])).abs().max()) < 3e-4  # uncorrected it is 9e-3


def test_a_gap_is_not_observed() -> None:
    time = np.arange(100) * 0.01
    angle = np.sin(time)
    angle[40:60] = np.nan
    (grid,) = run_grids(table(time, np.zeros(100), angle), 0.01)
    assert bool(grid.observed[:40].all())
    assert not bool(grid.observed[41:59].any())


def test_the_step_is_a_whole_number_of_timesteps() -> None:
    measured = table(np.arange(50) * 0.01, np.zeros(50), np.zeros(50))
    assert even_step(measured, 0.002) == pytest.approx(0.01)
    assert even_step(measured, 0.003) == pytest.approx(0.009)  # the nearest multiple
    assert even_step(measured, 0.05) == pytest.approx(0.05)
