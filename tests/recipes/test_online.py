"""The recipes' short forms, and the table of the study made from their logs."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest

from onlinebayes.experiments import Options, Settings, closing_line, run
from onlinebayes.inference import saving
from onlinebayes.runs import BadInput
from recipes import (
    acrobot,
    cartpole,
    custom_gym,
    custom_loop,
    dm_control,
    from_logs,
    hopper,
    mountain_car,
    own_simulator,
    pendulum,
    reach,
    skid_steer,
    tie,
)
from recipes.studies import survival
from recipes.studies.online import Curve, Study, _frames_to, tabulate

BUILDS = {
    "acrobot": acrobot.build,
    "cartpole": cartpole.build,
    "mountain_car": mountain_car.build,
    "pendulum": pendulum.build,
    "reach": reach.build,
    "skid_steer": skid_steer.build,
}
Capture = pytest.CaptureFixture[str]
checked_elsewhere = pytest.mark.usefixtures("without_shape_checks")


@pytest.mark.slow
@checked_elsewhere
@pytest.mark.parametrize("name", sorted(BUILDS))
def test_a_short_run_writes_its_folder_and_holds_the_truth_better_than_the_prior(
    name: str, tmp_path: Path, capsys: Capture
) -> None:
    """Seeds are fixed: no false failures on one machine."""
    assert run(name, BUILDS[name], Settings(short=True, out=str(tmp_path))) == 0
    rows = left(tmp_path / f"{name}-online-0-short", capsys.readouterr().out)
    assert [row["step"] for row in rows] == ["1", "2"]
    assert all("narrowed" in row["notes"] or "widened" in row["notes"] for row in rows)


@pytest.mark.slow
@checked_elsewhere
@pytest.mark.parametrize("real", ["mujoco", "drake"])
def test_a_hopper_is_measured_and_judged_in_either_engine(real: hopper.Engine, tmp_path: Path, capsys: Capture) -> None:
    if real == "drake":
        pytest.importorskip("pydrake", reason="needs the extra robotics")
    # What two batches teach says nothing of the friction: the pieces connect, and no more.
    run("hopper", hopper.build, hopper.Settings(short=True, real=real, out=str(tmp_path)))
    rows = left(tmp_path / "hopper-online-0-short", capsys.readouterr().out)
    assert float(rows[-1]["figure/return"]) > float(rows[0]["figure/return"])
    assert all(float(row["figure/log density of the truth"]) > 0 for row in rows)


def left(folder: Path, said: str) -> list[dict[str, str]]:
    """The log's rows of a run that wrote its whole folder, and said so."""
    assert {"run.json", "run.rrd", "run.html", "log.csv"} <= {path.name for path in folder.iterdir()}
    assert closing_line(folder) in said
    assert (folder / "run.rrd").stat().st_size < 50e6
    page = (folder / "run.html").read_text("utf-8")
    assert all(words in page for words in ("An episode", "return"))
    with (folder / "log.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert ("<svg" in page) == (len(rows) > 1)  # one point is no curve
    return rows


@pytest.mark.slow
@checked_elsewhere
def test_a_gymnasium_environment_stands_in_for_a_simulator(tmp_path: Path, capsys: Capture) -> None:
    assert run("custom_gym", custom_gym.build, custom_gym.Settings(short=True, out=str(tmp_path))) == 0
    assert len(left(tmp_path / "custom_gym-online-0-short", capsys.readouterr().out)) == 2


@pytest.mark.slow
@checked_elsewhere
def test_our_pieces_work_in_a_loop_of_ones_own(tmp_path: Path, capsys: Capture) -> None:
    assert custom_loop.main(Options(short=True, out=str(tmp_path))) == 0
    rows = left(tmp_path / "custom_loop-0-short", capsys.readouterr().out)
    assert float(rows[-1]["belief/mass/sd"]) < float(rows[0]["belief/mass/sd"]) / 3


@pytest.mark.slow
@checked_elsewhere
def test_a_function_is_a_simulator(tmp_path: Path, capsys: Capture) -> None:
    assert own_simulator.main(own_simulator.Settings(short=True, out=str(tmp_path))) == 0
    said, folder = capsys.readouterr().out, tmp_path / "own_simulator-0-short"
    assert closing_line(folder) in said
    assert "The belief" in (folder / "run.html").read_text("utf-8")
    assert "% region holds" in said
    assert "of the prior's width" in said
    assert (folder / "corner.png").read_bytes().startswith(b"\x89PNG")
    assert saving.load(folder / "posterior.json", own_simulator.SPACE).space == own_simulator.SPACE


def test_the_function_swings_as_a_spring_does() -> None:
    """At sqrt(k / m - (d / 2 m)^2), read without noise to a hundredth: its own step is a fiftieth of a second."""
    random, theta = np.random.default_rng(0), np.array([[1.0, 8.0, 0.5]])
    seen = own_simulator.simulate(theta, np.zeros((1, own_simulator.STEPS)), random)[0]
    t = own_simulator.DT * np.arange(own_simulator.STEPS + 1)
    rate, decay = np.sqrt(8.0 - 0.25**2), 0.25
    exact = 0.3 * np.exp(-decay * t) * (np.cos(rate * t) + decay / rate * np.sin(rate * t))
    assert np.abs(seen[:, 0] - exact).max() < 0.01 + 4 * own_simulator.NOISE


@pytest.mark.slow
@checked_elsewhere
def test_a_task_of_dm_control_is_learnt_in(tmp_path: Path, capsys: Capture) -> None:
    assert dm_control.run(dm_control.Settings(short=True, out=str(tmp_path))) == 0
    folder = tmp_path / "dm_control-cartpole-swingup-prior-0-short"
    assert len(left(folder, capsys.readouterr().out)) == 2
    assert list(folder.glob("checkpoint-*.pt"))


@pytest.mark.slow
@checked_elsewhere
def test_a_log_becomes_a_policy(tmp_path: Path, capsys: Capture) -> None:
    assert from_logs.main(Options(short=True, out=str(tmp_path))) == 0
    said, folder = capsys.readouterr().out, tmp_path / "from_logs-0-short"
    assert "missing: actuator_delay@motor" in said
    rows = left(folder, said)
    assert float(rows[0]["seconds/refine"]) > 0
    assert float(rows[-1]["figure/return"]) > float(rows[0]["figure/return"])
    assert (folder / "checkpoint-000001.pt").exists()


@pytest.mark.slow
@checked_elsewhere
def test_a_tie_becomes_a_policy_for_both(tmp_path: Path, capsys: Capture) -> None:
    assert tie.main(Options(short=True, out=str(tmp_path))) == 0
    said = capsys.readouterr().out
    assert "actuator_delay@motor: believed to" in said
    assert "actuator_lag@motor: believed to" in said
    assert "return of 100, policy for all of them" in said
    assert len(left(tmp_path / "tie-0-short", said)) == 4


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


def test_the_table_measures_each_run_by_its_oracle() -> None:
    returns = {"online": (-40, -1), "posterior-first": (-90, -5), "prior": (-80, -70), "oracle": (-9, 0)}
    curves = {
        ("pendulum", kind, 1): Curve((1500, 2500) if kind == "online" else (5000, 6000), each, 3.0, -100.0)
        for kind, each in returns.items()
    }
    rows = {row.name: row for row in tabulate(Study(tasks=("pendulum",), seeds=(1,)), curves).rows}
    online = rows["pendulum, online: share of the oracle's return"]
    assert (online.value, online.holds) == (0.99, True)
    assert rows["pendulum, prior: share of the oracle's return"].value == pytest.approx(0.3)
    assert rows["pendulum, online: frames to 0.95 of the oracle's return"].value == 2500
    parts = rows["pendulum: online's share of the frames of a posterior first"]
    assert (parts.value, parts.holds) == (2500 / 6000, True)
    assert rows["pendulum, online: log density of the truth"].value == 3
