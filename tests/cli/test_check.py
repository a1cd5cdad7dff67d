"""``onlinebayes check``: its statuses, its ten lines, its files, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from onlinebayes.cli.main import main
from onlinebayes.measurements import Measurement
from tests.criticism.checking.rig import ARM, DAMPING, MASS, record

PROBLEM = """
schema = 1
model = "arm.xml"
measurements = ["arm.csv"]
holdout = ["run7"]
[parameters]
"body.arm.mass" = [0.3, 3.0]
"joint.hinge.damping" = [0.0, 1.0]
[signals."qpos.hinge"]
sd = 1e-3
"""


def table(measurement: Measurement) -> str:
    """The measurement as CSV."""
    rows = ["run,time,ctrl.motor,qpos.hinge"]
    for name, run in zip(measurement.runs, measurement.data, strict=True):
        for row in run:
            values = (row["time"], row["command"][0], row["signal"][0])
            rows.append(f"{name}," + ",".join(f"{float(value):.9g}" for value in values))
    return "\n".join(rows) + "\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """As ``refine`` leaves it."""
    monkeypatch.setenv("ONLINEBAYES_CACHE", str(tmp_path / "cache"))
    (tmp_path / "arm.xml").write_text(ARM)
    (tmp_path / "arm.csv").write_text(table(record(8, 0)))
    (tmp_path / "refined.toml").write_text(PROBLEM)
    names, mean = ("body.arm.mass", "joint.hinge.damping"), (MASS, DAMPING)
    parameters = {name: {"mean": value, "sd": 1e-3} for name, value in zip(names, mean, strict=True)}
    belief = {"names": names, "mean": mean, "sd": [1e-3, 1e-3], "correlation": [[1, 0], [0, 1]]}
    one = {"weight": 1.0, "accepted": [], "parameters": parameters, "belief": belief}
    (tmp_path / "report.json").write_text(json.dumps({"hypotheses": [one], "parameters": parameters}))
    return tmp_path


@pytest.mark.slow
def test_an_unchanged_machine_is_status_0_and_a_changed_one_1(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "same.csv").write_text(table(record(2, 50)))
    assert main(["check", str(folder), str(folder / "same.csv")]) == 0
    assert capsys.readouterr().out.startswith("verdict:   holds: ")
    told = json.loads((folder / "check.json").read_text())
    assert (told["schema"], told["verdict"], told["changes"]) == (1, "holds", [])
    assert told["new_runs"] == ["same:run0", "same:run1"]
    (folder / "worn.csv").write_text(table(record(2, 53, damping=0.1, name="late")))
    out = folder / "tonight"
    logs = [str(folder / name) for name in ("same.csv", "worn.csv")]
    assert main(["check", str(folder), *logs, "--out", str(out)]) == 1
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) <= 10
    assert all(len(line) <= 80 or str(out) in line for line in printed)
    text = " ".join(" ".join(printed).split())
    assert "joint.hinge.damping is 1.25 times as large" in text
    assert "since run late0" in text
    assert {path.name for path in out.iterdir()} == {"check.json", "check.png"}
    (change,) = json.loads((out / "check.json").read_text())["changes"]
    assert change["since"] == {"run": "late0", "time": None, "first": False}
    assert change["low"] < 0.1 < change["high"]


def test_what_cannot_be_used_is_status_2_and_one_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "bare.csv").write_text("run,time,ctrl.motor\n" + "".join(f"a,{k / 100},0\n" for k in range(400)))
    (folder / "same.csv").write_text(table(record(1, 50)))
    asked = {
        "no such file": [str(folder), str(folder / "none.csv")],
        "stands in two logs": [str(folder), str(folder / "same.csv"), str(folder / "same.csv")],
        "bare.csv": [str(folder), str(folder / "bare.csv")],
        "holds no refined": [str(folder / "nowhere"), str(folder / "same.csv")],
        "required: LOG": [str(folder)],
    }
    for said, arguments in asked.items():
        assert main(["check", *arguments]) == 2, said
        printed = capsys.readouterr()
        assert said in printed.err
        assert printed.out == ""
        assert "Traceback" not in printed.err
    assert not (folder / "check.json").exists()


def test_a_fault_of_ours_is_no_answer(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("broken")

    monkeypatch.setattr("onlinebayes.cli.check.check_logs", broken)
    assert main(["check", str(folder), str(folder / "arm.csv")]) == 3
    assert "a fault of onlinebayes" in capsys.readouterr().err
