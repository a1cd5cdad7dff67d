"""``onlinebayes next``: the command table it writes, its page, and what it refuses."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from onlinebayes.cli import next as following
from onlinebayes.cli.main import main
from onlinebayes.runs import Interrupt
from tests.problems.conftest import MODEL, PROBLEM, table

QUICK = """
[effects]
candidates = ["constant_load", "quadratic_drag"]
[next]
max_command = 3.0
travel = [-2.0, 2.0]
max_speed = { carriage = 3.0 }
seconds = 3.0
"""


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder that the command wrote, and what it printed."""
    folder = tmp_path_factory.mktemp("next")
    (folder / "carriage.xml").write_text(MODEL)
    (folder / "carriage.csv").write_text(table(8.0))
    (folder / "carriage.toml").write_text(PROBLEM + QUICK)
    with pytest.MonkeyPatch.context() as patch:
        lines: list[str] = []
        patch.setattr("builtins.print", lambda *text, **where: lines.append(" ".join(text)) if not where else None)
        assert main(["next", str(folder / "carriage.toml"), "--out", str(folder / "out")]) == 0
    return folder / "out", "\n".join(lines)


@pytest.mark.long
def test_the_command_table_can_be_played(done: tuple[Path, str]) -> None:
    """One column an actuator on the measurements' clock, within the limits, from and to the held command."""
    head, *rows = (done[0] / "next.csv").read_text().splitlines()
    values = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    assert head == "time,ctrl.motor"
    assert np.allclose(np.diff(values[:, 0]), 0.01)
    assert values[-1, 0] == pytest.approx(3.0)
    assert 0.1 < np.abs(values[:, 1]).max() <= 3.0
    assert values[0, 1] == values[-1, 1]


def test_the_result_says_what_it_expects(done: tuple[Path, str]) -> None:
    """Every pair of rivals with the expected separation, every input tried; the page shows what they predict."""
    folder, printed = done
    found = json.loads((folder / "next.json").read_text())
    assert found["schema"] == 2
    assert found["recordings"] >= 3
    assert found["start"].keys() == {"carriage"}
    assert found["chosen"] == found["tried"][0]
    assert len(found["tried"]) > 10
    assert all(pair["structural"] == (pair["best"] < 4) for pair in found["rivalries"])
    for number, pair in enumerate(found["rivalries"]):
        assert pair["decides"] == (pair["sigma"] >= 4 and pair["gain"] >= 0.05)
        assert pair["gain"] == found["chosen"]["sigma"][number]["gain"]
        assert not (pair["structural"] and pair["too_small"])
    page = (folder / "next.html").read_text()
    assert "ctrl.motor" in page
    assert all(name in page for pair in found["rivalries"] for name in pair["names"])
    assert sorted(path.name for path in folder.iterdir()) == ["next.csv", "next.html", "next.json"]
    assert "next:" in printed
    assert max(map(len, printed.splitlines())) <= 80 + len(str(folder))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_is_said_and_leaves_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    """Asked for while the recording is sought: the first one asks the work to end, and no file is written."""

    def pressed(*_given: object, interrupt: Interrupt, **_named: object) -> None:
        signal.raise_signal(number)
        assert interrupt.requested

    monkeypatch.setattr(following, "criticise", lambda _command, _problem, _budget: SimpleNamespace(interrupted=False))
    monkeypatch.setattr(following, "next_experiment", pressed)
    assert main(["next", str(folder / "carriage.toml"), "--out", str(folder / "out")]) == 130
    assert "stopped before its end; nothing is proposed" in capsys.readouterr().err
    assert not (folder / "out").exists()


def test_a_model_without_actuators_is_one_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Before any long work: there is no command to propose."""
    start, _, rest = MODEL.partition("<actuator>")
    (folder / "carriage.xml").write_text(start + rest.partition("</actuator>")[2])
    rows = (line.split(",") for line in table(8.0).splitlines())
    (folder / "carriage.csv").write_text("".join(f"{run},{time},{q}\n" for run, time, _, q in rows))
    assert main(["next", str(folder / "carriage.toml"), "--out", str(folder / "out")]) == 2
    assert "model: it has no actuators" in capsys.readouterr().err
    assert not (folder / "out").exists()


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("[next]\nmax_comand = 1.0", "next.max_comand: unknown key; nearest: max_command"),
        ("[next]\nmax_command = -1.0", "next.max_command: -1 is not above zero"),
        ("[next]\nmax_rate = { moter = 1.0 }", "next.max_rate.moter: unknown key; nearest: motor"),
        ("[next]\ntravel = [1.0, -1.0]", "next.travel: [1, -1] holds no position"),
        ("[next]\npayload = { body = 'cariage', mass = 1.0 }", "no body 'cariage'; nearest: carriage"),
        ("[next]\npayload = { body = 'carriage' }", "next.payload.mass: missing"),
        ("[next]\nseconds = 0", "next.seconds: 0 is not above zero"),
    ],
)
def test_limits_that_make_no_sense_are_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], lines: str, message: str
) -> None:
    """File, key, what is wrong, what to do; nothing is written."""
    (folder / "carriage.toml").write_text(PROBLEM + lines)
    assert main(["next", str(folder / "carriage.toml"), "--out", str(folder / "out")]) == 2
    assert message in capsys.readouterr().err
    assert not (folder / "out").exists()
