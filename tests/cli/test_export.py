"""``onlinebayes export``: its files and its line, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from onlinebayes.cli.main import EXPORTS, main
from onlinebayes.export import TARGETS, files_of
from tests.export.conftest import folder

__all__ = ["folder"]


def test_the_command_offers_every_target() -> None:
    assert EXPORTS == TARGETS


@pytest.mark.parametrize("target", TARGETS)
def test_each_target_writes_its_files(
    folder: Path, tmp_path: Path, target: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["export", str(folder), "--to", target, "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == {*files_of(target)}
    assert capsys.readouterr().out.startswith("wrote:     ")
    assert json.loads((out / "worlds.json").read_text())["schema"] == "onlinebayes-worlds"


def test_what_cannot_be_used_is_one_line(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = {
        "holds no refined": [str(tmp_path), "--to", "json", "--out", str(tmp_path / "out")],
        "invalid choice: 'gazebo'": [str(folder), "--to", "gazebo", "--out", str(tmp_path / "out")],
        "would be written over": [str(folder), "--to", "mujoco", "--out", str(folder)],
    }
    (folder / "refined.xml").write_text("<mujoco/>")
    for said, arguments in asked.items():
        assert main(["export", *arguments]) == 2
        printed = capsys.readouterr()
        assert said in printed.err
        assert len(printed.err.splitlines()) == 1
        assert printed.out == ""
    assert not (tmp_path / "out").exists()
