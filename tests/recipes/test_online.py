"""The recipes' short forms, and the table of the study made from their logs."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import pytest

from onlinebayes.runs import BadInput
from recipes import acrobot, cartpole, custom_gym, custom_loop, dm_control, from_logs, mountain_car, pendulum, reach
from recipes.common import Settings, run
from recipes.studies import survival
from recipes.studies.online import Study, _frames_to, tabulate

BUILDS = {
    "acrobot": acrobot.build,
    "cartpole": cartpole.build,
    "mountain_car": mountain_car.build,
    "pendulum": pendulum.build,
    "reach": reach.build,
}
checked_elsewhere = pytest.mark.usefixtures("without_shape_checks")


@pytest.mark.slow
@checked_elsewhere
@pytest.mark.parametrize("name", sorted(BUILDS))
def test_a_short_run_writes_its_folder_and_holds_the_truth_better_than_the_prior(name: str, tmp_path: Path) -> None:
    """Seeds are fixed: no false failures on one machine."""
    assert run(name, BUILDS[name], Settings(short=True, out=str(tmp_path))) == 0
    folder = tmp_path / f"{name}-online-0-short"
    assert (folder / "run.rrd").stat().st_size < 50e6
    assert "<svg" in (folder / "run.html").read_text("utf-8")
    with (folder / "log.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["step"] for row in rows] == ["1", "2"]
    assert all("narrowed" in row["notes"] or "widened" in row["notes"] for row in rows)


@pytest.mark.slow
@checked_elsewhere
def test_a_gymnasium_environment_stands_in_for_a_simulator(tmp_path: Path) -> None:
    assert custom_gym.main(custom_gym.Settings(short=True, out=str(tmp_path))) == 0


@pytest.mark.slow
@checked_elsewhere
def test_our_pieces_work_in_a_loop_of_ones_own() -> None:
    assert custom_loop.main(custom_loop.Settings(batches=20)) == 0


@pytest.mark.slow
@checked_elsewhere
def test_a_task_of_dm_control_is_learnt_in(tmp_path: Path) -> None:
    assert dm_control.main(dm_control.Settings(short=True, out=str(tmp_path))) == 0
    assert (tmp_path / "checkpoint-000001.pt").exists()


@pytest.mark.slow
@checked_elsewhere
def test_a_log_becomes_a_policy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert from_logs.main(from_logs.Settings(short=True, out=str(tmp_path))) == 0
    assert "missing: actuator_delay@motor" in capsys.readouterr().out
    assert (tmp_path / "checkpoint-000001.pt").exists()


@pytest.mark.slow
@checked_elsewhere
def test_a_killed_recipe_ends_as_if_it_had_not_been(tmp_path: Path) -> None:
    """One kill in the middle; ``make survival`` has twenty. Where the second run is faster, an earlier one."""
    seconds = survival.played("pendulum", tmp_path / "whole")
    for share in (0.7, 0.5, 0.35):
        shutil.rmtree(tmp_path / "killed", ignore_errors=True)
        if not survival.played_until("pendulum", tmp_path / "killed", share * seconds):
            break
    else:
        pytest.fail("the run ended before it was killed, three times")
    survival.played("pendulum", tmp_path / "killed")
    first, second = (survival.last(tmp_path / name, "pendulum") for name in ("whole", "killed"))
    assert survival.differing(first, second) == []
    second["generator"] = second["generator"].clone().add_(1)
    assert survival.differing(first, second) == ["/generator"]


@pytest.mark.parametrize(("seed", "noise"), [(-1, 0.0), (0, -0.1), (0, 1.0)])
def test_settings_out_of_bounds_are_refused(seed: int, noise: float) -> None:
    with pytest.raises(BadInput, match="needs seed >= 0"):
        Settings(seed=seed, noise=noise)


def test_frames_count_from_where_the_share_is_kept() -> None:
    assert _frames_to(0.95, (1, 2, 3, 4), (0.99, 0.5, 0.96, 1.0)) == 3
    assert _frames_to(0.95, (1, 2), (1.0, 0.9)) == float("inf")


def test_the_table_measures_each_run_by_its_oracle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("recipes.studies.online._untrained", lambda task, seed: -100.0)
    for kind, returns in (
        ("online", (-40, -1)),
        ("posterior-first", (-90, -5)),
        ("prior", (-80, -70)),
        ("oracle", (-9, 0)),
    ):
        folder = tmp_path / f"pendulum-{kind}-1"
        folder.mkdir()
        lines = ["frames,simulated,figure/return,figure/log density of the truth", "0,50,-100,1"]
        lines += [
            f"{1000 * (i + 1)},{500 * (1 + (kind != 'online') * 7)},{value},{2 + i}" for i, value in enumerate(returns)
        ]
        (folder / "log.csv").write_text("\n".join(lines))
    rows = {row.name: row for row in tabulate(Study(tasks=("pendulum",), seeds=(1,), out=str(tmp_path))).rows}
    online = rows["pendulum, online: share of the oracle's return"]
    assert (online.value, online.holds) == (0.99, True)
    assert rows["pendulum, prior: share of the oracle's return"].value == pytest.approx(0.3)
    assert rows["pendulum, online: frames to 0.95 of the oracle's return"].value == 2500
    parts = rows["pendulum: online's share of the frames of a posterior first"]
    assert (parts.value, parts.holds) == (2500 / 6000, True)
    assert rows["pendulum, online: log density of the truth"].value == 3
