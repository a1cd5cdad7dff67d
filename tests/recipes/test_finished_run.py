"""A study judges a run that ended, made with the settings that it asks for, and no other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from onlinebayes import experiments
from onlinebayes.experiments import Settings
from onlinebayes.runs import BadInput
from recipes import pendulum
from recipes.studies.finished_run import finished_run

pytestmark = pytest.mark.usefixtures("without_shape_checks")


@pytest.fixture(scope="module")
def settings(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    """Of a short run that has ended."""
    told = Settings(seed=1, short=True, out=str(tmp_path_factory.mktemp("finished")))
    _, state = finished_run("pendulum", pendulum.build, told)
    assert state.step > 0
    return told


@pytest.mark.slow
def test_an_ended_run_is_not_done_again(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("recipes.studies.finished_run.run", None)
    _, state = finished_run("pendulum", pendulum.build, settings)
    assert state.step > 0


@pytest.mark.slow
def test_another_run_in_its_folder_is_refused(settings: Settings) -> None:
    with pytest.raises(BadInput, match="noise"):
        finished_run("pendulum", pendulum.build, replace(settings, noise=0.05))


@pytest.mark.slow
def test_a_run_without_its_checkpoints_is_refused(settings: Settings) -> None:
    for file in Path(experiments.place_of("pendulum", settings)).glob("checkpoint-*"):
        file.unlink()
    with pytest.raises(BadInput, match="no checkpoint"):
        finished_run("pendulum", pendulum.build, settings)


@pytest.mark.slow
def test_a_stopped_run_stops_the_study(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("recipes.studies.finished_run.run", lambda *_: 130)
    with pytest.raises(KeyboardInterrupt):
        finished_run("pendulum", pendulum.build, replace(settings, seed=2))
