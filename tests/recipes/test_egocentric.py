"""The sensor choice: stretches, curves, budgets by hand, and the recipe's short form."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
import torch

from envs.egocentric import Stretches, made_up
from recipes import egocentric
from recipes.sensor_budget import SHARES, Choices, choices, day, share_paid
from recipes.sensor_choice import accuracy_at, folds, mixed, outcome, stretches


def seen() -> Stretches:
    """Two sequences of two seconds: motion is right in the first, vision in the second."""
    right = torch.tensor([[True, True], [False, False]])
    rate = torch.tensor([[0.5, 0.5], [1.0, 1.0]])
    return Stretches(torch.zeros(2, 2, 1), right, rate, torch.tensor([2, 2]), torch.arange(2))


def test_stretches_are_runs_of_chosen_seconds() -> None:
    sequences = made_up(3)
    chosen = torch.zeros(3, 15, dtype=torch.bool)
    chosen[0, 2:5] = chosen[0, 9:] = chosen[2, 0] = True
    made = stretches(sequences, torch.randn(3, 15, 20).log_softmax(-1), torch.linspace(0, 1, 20), chosen)
    assert made.length.tolist() == [3, 6, 1]
    assert made.sequence.tolist() == [0, 0, 2]
    assert not made.features[0, 3:].any()
    assert made.vision_rate[2, 0] == torch.linspace(0, 1, 20)[2]


def test_folds_spread_each_activity() -> None:
    fold = folds(made_up(100), 5, torch.Generator().manual_seed(0))
    assert (fold == fold[:, :1]).all()
    for label in range(20):
        assert sorted(fold[torch.arange(100) % 20 == label, 0].tolist()) == [0, 1, 2, 3, 4]


def test_accuracy_over_use_by_hand() -> None:
    score = torch.tensor([[0.0, 0.1], [2.0, 1.0]])
    assert accuracy_at(seen(), score, (0.0, 0.25, 0.5, 0.75, 1.0)).tolist() == [0.5, 0.75, 1.0, 0.875, 0.75]
    assert mixed(seen(), (0.0, 0.5, 1.0)).tolist() == [0.5, 0.625, 0.75]
    assert outcome(seen(), score > 0.5) == (0.5, 1.0)


def test_a_battery_pays_for_what_is_left_after_the_motion_sensors() -> None:
    theta = torch.tensor([150.0, 300.0], dtype=torch.float64)
    charge = torch.tensor([100.0, 300.0, 900.0], dtype=torch.float64)
    assert share_paid(charge, 3600.0, theta).tolist() == [0.0, 0.5, 1.0]


def test_the_camera_is_asked_in_the_share_that_is_paid() -> None:
    told = choices(torch.tensor([[0.0, 0.1], [2.0, 1.0]]), seen())
    half = len(SHARES) // 2
    assert [told.use[k].mean().item() for k in (0, half, -1)] == [0.0, 0.5, 0.75]  # of ties and ends fewer
    assert told.accuracy[half].tolist() == [1.0, 1.0]


def test_who_believes_in_too_small_currents_stands_with_an_empty_battery() -> None:
    use = SHARES[:, None].expand(-1, 3)
    told = Choices(use, 0.5 + 0.4 * use)
    truth = torch.tensor([300.0, 600.0], dtype=torch.float64)
    right, wrong = (day(told, truth, believed, share=0.3, phones=4) for believed in (truth, truth / 2))
    assert right.lasted.min() > 0.99
    assert right.use.mean() == pytest.approx(0.3, abs=0.02)
    assert wrong.lasted.max() < 0.95
    assert wrong.accuracy.mean() < right.accuracy.mean()


@pytest.mark.slow
@pytest.mark.usefixtures("without_shape_checks")
def test_the_recipe_does_what_it_promises(tmp_path, capsys) -> None:
    """Seeds are fixed: no false failures on one machine."""
    assert egocentric.main(egocentric.Settings(short=True, out=str(tmp_path))) == 0
    assert "points of accuracy" in capsys.readouterr().out
    assert {path.name for path in (tmp_path / "egocentric-0-short").iterdir()} == {"battery.csv", "episode.rrd"}


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_data_that_is_absent_is_one_line_and_status_two(tmp_path) -> None:
    command = [sys.executable, "-m", "recipes.egocentric", "--recorded", "--out", str(tmp_path)]
    environment = {name: value for name, value in os.environ.items() if name != "ONLINEBAYES_DATA"}
    made = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert made.returncode == 2
    assert made.stderr.strip().splitlines()[-1].startswith("ONLINEBAYES_DATA is not set; set it")
