"""A report folder: three files, replaced whole or not at all."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from onlinebayes.criticism.report import recording as recording_module
from onlinebayes.criticism.report import write_report
from onlinebayes.runs import BadInput
from tests.criticism.report.synthetic import criticism, drive


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
