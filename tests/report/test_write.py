"""A report folder: three files, replaced whole or not at all."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from types import ModuleType

import pytest

from onlinebayes.report import html, refined, write, write_report
from onlinebayes.report import recording as recording_module
from onlinebayes.runs import Attempts, BadInput
from tests.report.synthetic import criticism, drive


def test_three_files_and_nothing_else(tmp_path: Path) -> None:
    written = write_report(criticism(), tmp_path / "new" / "folder", title="drive.toml")
    assert sorted(p.name for p in (tmp_path / "new" / "folder").iterdir()) == ["report.html", "report.json", "run.rrd"]
    assert sorted(written) == ["report.html", "report.json", "run.rrd"]
    assert json.loads((tmp_path / "new" / "folder" / "report.json").read_text())["schema"] == 1


@pytest.mark.parametrize(("command", "more"), [("refine", ("refined.xml",)), ("diagnose", ())])
def test_only_refine_writes_a_refined_model(tmp_path: Path, command: str, more: tuple[str, ...]) -> None:
    result = dataclasses.replace(criticism(simulator=drive()), command=command)
    assert write_report(result, tmp_path)[:-3] == more
    page = (tmp_path / "report.html").read_text()
    assert ("from_xml_path" in page) == (command == "refine")
    assert "onlinebayes compare refined.toml" not in page
    assert ("onlinebayes refine adds it" in page) == (command == "diagnose")


def test_a_failure_leaves_the_old_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_report(criticism(), tmp_path)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}

    def fail(*_: object) -> str:
        raise RuntimeError("disk on fire")

    monkeypatch.setattr(recording_module.documents, "ranking", fail)
    with pytest.raises(RuntimeError, match="disk on fire"):
        write_report(criticism(), tmp_path)
    after = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    assert after.keys() == before.keys()
    assert after["run.rrd"] == before["run.rrd"]


@pytest.mark.parametrize(("mass", "refused"), [(0.0, True), (95.0, False)])
def test_a_model_that_mujoco_refuses_leaves_the_report(tmp_path: Path, mass: float, refused: bool) -> None:
    """A mass that ends at its bound of 0 makes no file; an older one is not left beside the new report."""
    (tmp_path / "refined.xml").write_text("old")
    result = dataclasses.replace(criticism(simulator=drive()), command="refine")
    theta = result.final.theta.clone()
    theta[result.final.simulator.parameters.index("body.carriage.mass")] = mass
    result = dataclasses.replace(result, final=dataclasses.replace(result.final, theta=theta))
    files = write_report(result, tmp_path)
    assert ("refined.xml" in files) == (tmp_path / "refined.xml").is_file() == (not refused)
    said = [note for note in json.loads((tmp_path / "report.json").read_text())["notes"] if "refined.xml" in note]
    assert bool(said) == refused
    assert ("refined.xml was not written, for MuJoCo refuses" in (tmp_path / "report.html").read_text()) == refused


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="cannot write here"):
        write_report(criticism(), tmp_path / "file" / "out")


@pytest.mark.usefixtures("faults_are_noted")
@pytest.mark.parametrize(
    ("module", "part", "lost"),
    [
        (html.accuracy, "picture", None),
        (html.ranking, "render", None),
        (html.summary, "headline", None),
        (html.usage, "advice", None),
        (recording_module.documents, "ranking", "run.rrd"),
        (write, "to_json", "report.json"),
        (refined, "write_model", "refined.xml"),
        (refined, "noted", None),
    ],
)
def test_a_part_that_fails_leaves_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: ModuleType, part: str, lost: str | None
) -> None:
    def fail(*_: object, **__: object) -> str:
        raise IndexError("disk on fire")

    monkeypatch.setattr(module, part, fail)
    if part == "noted":
        monkeypatch.setattr(write, part, fail)
    attempts = Attempts()
    result = dataclasses.replace(criticism(simulator=drive()), command="refine")
    written = write_report(result, tmp_path, attempts=attempts)
    every = {"refined.xml", "report.html", "run.rrd", "report.json"}
    assert set(written) == {path.name for path in tmp_path.iterdir()} == every - {lost}
    (line,) = attempts.failed
    assert "failed by a fault of onlinebayes: IndexError: disk on fire (test_write.py, line" in line
    if lost != "report.json":
        assert json.loads((tmp_path / "report.json").read_text())["failed"] == [line]
    if module in (html.accuracy, html.ranking, html.summary, html.usage):
        page = (tmp_path / "report.html").read_text()
        assert "IndexError: disk on fire" in page
        assert "How this was reached" in page


@pytest.mark.usefixtures("faults_are_noted")
def test_without_anybody_to_tell_the_first_failure_is_raised_when_the_rest_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(html.ranking, "render", lambda _: 1 // 0)
    with pytest.raises(ZeroDivisionError):
        write_report(criticism(), tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["report.html", "report.json", "run.rrd"]
