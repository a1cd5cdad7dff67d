"""Runs that earlier versions saved go on in this one."""

from __future__ import annotations

import csv
import math
import shutil
from pathlib import Path

import pytest
import torch

import onlinebayes
from tests.trainers.saved_run import PRIOR, SAVED, played

VERSIONS = sorted(path.name for path in SAVED.iterdir())


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "log.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_this_version_has_left_a_run_and_every_one_is_small() -> None:
    assert onlinebayes.__version__ in VERSIONS, "python -m tests.trainers.saved_run"
    for version in VERSIONS:
        assert sum(path.stat().st_size for path in (SAVED / version).iterdir()) < 100_000


@pytest.mark.usefixtures("without_shape_checks")
@pytest.mark.parametrize("version", VERSIONS)
def test_a_saved_run_goes_on(version: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "run"
    shutil.copytree(SAVED / version, folder)
    before = rows(folder)
    state = played(folder, 2)
    assert "going on in" in capsys.readouterr().out
    assert (state.step, state.frames) == (2, 2 * int(before[0]["frames"]))
    assert state.real.shape == (2, 10)
    assert [row["step"] for row in rows(folder)] == ["1", "2"]
    assert rows(folder)[0] == before[0]
    draws = state.belief.sample((500,), torch.Generator().manual_seed(0))
    assert PRIOR.space.contains(draws).all()
    assert math.isfinite(float(state.belief.log_prob(draws).mean()))


@pytest.mark.parametrize("version", VERSIONS)
def test_a_saved_policy_acts(version: str) -> None:
    action = onlinebayes.load_policy(SAVED / version).act([0.0, 0.0, 0.1, 0.0])
    assert sorted(action.tolist()) == [0, 1], "one of two pushes"
