import numpy as np
import pytest
import torch

from onlinebayes.identification.data.grid import even_step, replay_step, run_grids
from onlinebayes.identification.data.tiling import tile
from onlinebayes.identification.data.windows import _cut
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput


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


def test_what_jitters_keeps_its_value_and_its_instant() -> None:
    draw = np.random.default_rng(1)
    time = np.arange(400) * 0.01 + draw.uniform(-0.003, 0.003, 400)
    time -= time[0]
    (grid,) = run_grids(table(time, np.zeros(400), np.sin(3 * time)), 0.001)
    assert grid.reading is not None
    assert grid.late is not None
    seen = grid.observed[:, 0]
    at = 0.001 * (torch.arange(grid.rows + 1, dtype=torch.float64) + grid.late[:, 0])[seen]
    assert int(seen.sum()) == 399  # the last one lies beyond the last whole step
    assert torch.allclose(grid.reading[seen, 0], torch.sin(3 * at))
    assert float(grid.late.abs().max()) <= 0.5001
    (even,) = run_grids(table(np.arange(400) * 0.01, np.zeros(400), np.sin(3 * time)), 0.01)
    assert even.late is None


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


def with_gap(first: int, second: int, gap: float) -> Measurement:
    """Two stretches at 100 Hz with a pause between them."""
    time = np.concatenate([np.arange(first) * 0.01, (first - 1) * 0.01 + gap + np.arange(second) * 0.01])
    return table(time, np.arange(first + second, dtype=float), np.sin(3 * time))


def test_a_gap_parts_the_grid_and_a_few_lost_rows_do_not() -> None:
    (grid,) = run_grids(with_gap(101, 51, 0.5), 0.01)
    assert grid.pieces == ((0, 100), (150, 200))
    (grid,) = run_grids(with_gap(101, 51, 0.06), 0.01)
    assert grid.pieces == ((0, 156),)
    assert int((~grid.observed).sum()) == 5


def test_no_window_bridges_a_gap() -> None:
    measurement = with_gap(131, 80, 5.0)
    grids = run_grids(measurement, 0.01)
    tiling = tile(measurement, grids, ("rail",), horizon=0.5)
    assert [g for _, g in tiling.places] == [0, 50, 100, 630, 680]
    assert tiling.rows == 50
    command, *_, inside, _ = _cut(grids[0], torch.tensor([100]), rows=50, history=0, idle=False)
    assert inside[0].tolist() == [True] * 30 + [False] * 20  # the stretch ends at row 130
    assert float(command.max()) == pytest.approx(130.0)
    _, _, past, *_ = _cut(grids[0], torch.tensor([630]), rows=50, history=9, idle=False)
    assert past[0, :, 0].tolist() == pytest.approx([131.0] * 9)  # the first after the gap


def test_commands_denser_than_the_measurements_do_not_set_the_step() -> None:
    time = np.arange(1001) * 1e-3
    angle = np.where(np.arange(1001) % 10 == 0, np.sin(3 * time), np.nan)
    measurement = table(time, np.arange(1001.0), angle)
    assert even_step(measurement, 1e-3) == pytest.approx(0.01)
    (grid,) = run_grids(measurement, 0.01)
    assert bool(grid.observed.all())
    assert grid.command[:3, 0].tolist() == pytest.approx([4.5, 14.5, 24.5])


def test_a_single_wrong_time_is_said_and_not_allocated() -> None:
    time = np.append(np.arange(100) * 0.01, 1e9)
    with pytest.raises(BadInput, match=r"run 'run' lasts 1e\+09 s"):
        run_grids(table(time, np.zeros(101), np.zeros(101)), 0.01)


def test_the_grid_has_a_row_where_any_signal_was_measured() -> None:
    row = np.arange(1000)
    time = row * 0.01
    for every, first, step in ((5, 3, 0.01), (4, 2, 0.02), (12, 6, 0.02), (8, 0, 0.04)):
        dense = 4 if every == 8 else 2
        measurement = Measurement.from_runs(
            {
                "run": {
                    "time": time,
                    "ctrl.motor": time,
                    "qpos.rail": np.where(row % dense == 0, np.sin(3 * time), np.nan),
                    "qvel.rail": np.where(row % every == first, np.cos(3 * time), np.nan),
                }
            }
        )
        assert even_step(measurement, 1e-3) == pytest.approx(step)


def test_a_stray_row_and_a_clock_that_jitters_do_not_refine_the_grid() -> None:
    row, draw = np.arange(2000), np.random.default_rng(0)
    velocity = np.where((row % 4 == 0) | (row == 1001), 1.0, np.nan)
    angle = np.where(row % 2 == 0, 1.0, np.nan)
    for time in (row * 0.01, row * 0.01 + draw.uniform(-0.001, 0.001, 2000)):
        run = {"time": time - time[0], "ctrl.motor": 0 * time, "qpos.rail": angle, "qvel.rail": velocity}
        assert even_step(Measurement.from_runs({"run": run}), 1e-3) == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("every", "changes", "jitter", "step"),
    [
        (1, 1, 0.0, 0.01),
        (5, 5, 0.0, 0.05),
        (5, 1, 0.0, 0.01),
        (1, 1, 0.2, 0.001),
        (1, 1, 1e-3, 0.01),
        (5, 1, 0.2, 0.001),
    ],
    ids=["even", "held for five rows", "denser commands", "jitter", "hardly any jitter", "both"],
)
def test_the_replay_is_driven_as_often_as_commands_and_jitter_ask_for(every, changes, jitter, step) -> None:
    row, draw = np.arange(1000), np.random.default_rng(0)
    time = 0.01 * (row + jitter * draw.uniform(-1, 1, 1000))
    time = time - time[0]
    measurement = table(time, np.sin(row // changes), np.where(row % every == 0, np.sin(3 * time), np.nan))
    assert replay_step(measurement, 1e-5) == pytest.approx(step, rel=0.01)
    assert even_step(measurement, 1e-5) == pytest.approx(0.01 * every, rel=0.01)


def test_a_fast_log_that_jitters_is_not_cut_below_a_millisecond() -> None:
    draw = np.random.default_rng(0)
    time = np.sort(0.002 * np.arange(1000) + 4e-4 * draw.uniform(-1, 1, 1000))
    assert replay_step(table(time - time[0], np.sin(time), np.sin(3 * time)), 1e-5) == pytest.approx(1e-3)
