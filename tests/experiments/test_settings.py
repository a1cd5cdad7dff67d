"""What an experiment is told, what is hidden from it, and what its folder remembers."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from onlinebayes.experiments import Options, Settings, folder_of, hidden_truth, place_of, recorded_settings
from onlinebayes.objectives import SACSettings, sac, settings_of
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput, RunFolder
from recipes import pendulum

SPACE = ParameterSpace({"mass": Parameter(1.0, 3.0, "kg"), "length": Parameter(0.5, 1.5, "m")})


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(BadInput, match="seed -1; needs seed >= 0"):
        Options(seed=-1)
    with pytest.raises(BadInput, match=r"noise 1.0; needs .* 0 <= noise < 1"):
        Settings(noise=1.0)


def test_seed_zero_hides_the_values_that_are_given_and_others_points_of_a_sequence() -> None:
    own = hidden_truth(SPACE, 0, {"mass": 2.5, "length": 0.6})
    assert own.tolist() == [2.5, 0.6]
    points = torch.stack([hidden_truth(SPACE, seed, {}) for seed in (1, 2, 3)])
    torch.testing.assert_close(points[:2], torch.tensor([[2.5, 0.75], [1.5, 1.25]], dtype=torch.float64))
    assert torch.equal(points[0], hidden_truth(SPACE, 1, {"mass": 1.0, "length": 0.5}))


def test_folders_are_called_after_experiment_kind_and_seed() -> None:
    assert folder_of("own", Options(seed=3)) == "own-3"
    assert place_of("pendulum", Settings(kind="prior", short=True)) == Path("out/pendulum-prior-0-short")


def test_a_run_is_the_same_in_another_folder_and_with_no_workers() -> None:
    assert set(recorded_settings(Settings(out="elsewhere"))) == {"seed", "short", "noise", "kind"}
    assert recorded_settings(Settings(ray_workers=2))["ray_workers"] == 2


def test_a_folder_remembers_the_objectives_settings_and_refuses_others(tmp_path: Path) -> None:
    made = pendulum.build(Settings(short=True))
    told = settings_of(made.trainer.objective)
    assert told["alpha"] == 0.3
    assert told == settings_of(sac(*made.problem.specs, pendulum.LEARNING))
    with RunFolder(tmp_path, "pendulum", objective=told):
        pass
    assert json.loads((tmp_path / "run.json").read_text("utf-8"))["objective"]["widths"] == [64, 64]
    with RunFolder(tmp_path, "pendulum", objective=told):
        pass
    with RunFolder(tmp_path, "pendulum"):  # who tells nothing of it asks nothing
        pass
    other = settings_of(sac(*made.problem.specs, SACSettings(alpha=0.5)))
    with pytest.raises(BadInput, match=r"alpha = 0\.3 \(now 0\.5\)"):
        RunFolder(tmp_path, "pendulum", objective=other).__enter__()
