"""The study of the front door: cases are judged by what is printed, and left out where they are not there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recipes.studies.front_door import Study
from recipes.studies.front_door_cases import Case, answer
from recipes.studies.front_door_exports import loaded_back
from recipes.studies.front_door_times import PENDULUM, many_joints, many_rows, spent
from tests.export.conftest import hypothesis, refined


@pytest.fixture
def case(tmp_path: Path) -> Case:
    """A log of a pendulum in a folder of its own."""
    folder = tmp_path / "pendulum"
    folder.mkdir()
    (folder / "model.xml").write_text(PENDULUM.format(""))
    time = np.arange(200) * 0.01
    rows = np.stack([time, np.sin(3 * time), 0.1 * np.sin(3 * time)], 1)
    np.savetxt(folder / "log.csv", rows, delimiter=",", header="time,motor_cmd,hinge_pos", comments="")
    return Case("pendulum", "init model.xml log.csv", {"qpos.hinge": "hinge_pos", "ctrl.motor": "motor_cmd"})


def test_a_case_is_right_where_all_of_it_is_said(case: Case, tmp_path: Path) -> None:
    here = Path.cwd()
    found = answer(case, tmp_path, tmp_path)
    assert (found.lacking, found.status) == ([], 0)
    assert found.seconds > 0
    other = replace(case, right={**case.right, "qpos.hinge": "motor_cmd"}, said=["never|wrote:", "not so"])
    assert answer(other, tmp_path, tmp_path).lacking == ["matched:   qpos.hinge <- motor_cmd", "not so"]
    assert Path.cwd() == here


def test_a_case_may_be_an_error(case: Case, tmp_path: Path) -> None:
    found = answer(Case("pendulum", "compare none.toml", said=("no such file",)), tmp_path, tmp_path)
    assert (found.lacking, found.status) == ([], 2)


def test_without_a_folder_the_cases_are_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ONLINEBAYES_DATA", raising=False)
    assert Study().folder is None
    monkeypatch.setenv("ONLINEBAYES_DATA", str(tmp_path / "data"))
    assert Study().folder is None
    (tmp_path / "cases" / "front-door").mkdir(parents=True)
    assert Study().folder == tmp_path / "cases" / "front-door"
    assert Study(cases=str(tmp_path)).folder == tmp_path


@pytest.mark.slow
def test_the_cost_of_a_command_is_measured_and_bounded(tmp_path: Path) -> None:
    cost = spent(many_joints(tmp_path / "few", legs=1, links=2), limit=120.0)
    assert cost.status == 0
    assert cost.processor > 0.5
    assert 0.05 < cost.memory < 4
    assert (tmp_path / "few" / "p.toml").is_file()
    stopped = spent(many_rows(tmp_path / "rows", rows=2000), limit=0.5)
    assert stopped.status != 0


def test_an_export_is_loaded_back(tmp_path: Path) -> None:
    effects = ["dry_friction@shoulder"]
    folder = refined(tmp_path / "refined", (effects, hypothesis(effects)))
    assert loaded_back(folder, "json", tmp_path / "out") == ""  # the friction is not the pendulum's
