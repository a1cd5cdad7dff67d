"""A command whose work fails in part writes its files, says the line, and exits with 1."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from onlinebayes.cli.main import main
from onlinebayes.criticism import commands
from onlinebayes.report import html


def fail(*_: object, **__: object) -> None:
    raise RuntimeError("the tensors differ")


@pytest.mark.usefixtures("faults_are_noted", "without_shape_checks")
def test_what_fails_is_one_line_and_the_report_is_there(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(commands, "find_fault", fail)
    monkeypatch.setattr(html.ranking, "render", fail)
    status = main(["compare", str(folder / "carriage.toml"), "--out", str(folder / "out")])
    said = capsys.readouterr()
    assert status == 1
    assert {path.name for path in (folder / "out").iterdir()} == {"report.json", "report.html", "run.rrd"}
    lines = [line for line in said.err.splitlines() if "failed" in line]
    assert len(lines) == 2
    for line, part in zip(lines, ("checking signs, units and columns", "the candidates (report.html)"), strict=True):
        assert line.startswith(
            f"onlinebayes: {part} failed by a fault of onlinebayes: RuntimeError: the tensors differ "
        )
        assert "(test_work.py, line " in line
        assert line.endswith("the report holds all that was found without it")
    assert "Traceback" not in said.err
    assert "verdict:" in said.out
    assert len(json.loads((folder / "out" / "report.json").read_text())["failed"]) == 2
