"""``show`` opens runs: all of their recordings, in order, whatever a kill did to them."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from onlinebayes.cli import show
from onlinebayes.cli.main import main

MESSAGE = struct.pack("<QQ", 2, 5) + b"hello"
WHOLE = b"RRF2" + bytes(8) + 2 * MESSAGE


@pytest.fixture
def run(tmp_path: Path) -> Path:
    (tmp_path / "run.html").write_text("<p>run</p>")
    (tmp_path / "run.json").write_text("{}")
    for name in ("run.rrd", "run-10.rrd", "run-2.rrd"):
        (tmp_path / name).write_bytes(WHOLE)
    return tmp_path


@pytest.fixture
def started(monkeypatch) -> list[list[str]]:
    commands: list[list[str]] = []
    monkeypatch.setattr(show, "has_screen", lambda: True)
    monkeypatch.setattr(show.webbrowser, "open", lambda url: bool(commands.append([url])) or True)
    monkeypatch.setattr(show.subprocess, "Popen", lambda command, **_options: commands.append(command[1:]))
    return commands


def test_all_recordings_of_a_run_are_opened_in_order(run, started, capsys):
    assert main(["show", str(run)]) == 0
    assert started == [[(run / "run.html").as_uri()], [str(run / f"run{n}.rrd") for n in ("", "-2", "-10")]]
    assert "run.json: recipe and settings" in capsys.readouterr().out


def test_the_page_alone(run, started):
    assert main(["show", "--html", str(run)]) == 0
    assert started == [[(run / "run.html").as_uri()]]


def test_a_run_before_its_first_page_has_a_recording(run, started, capsys):
    (run / "run.html").unlink()
    assert main(["show", str(run)]) == 0
    assert len(started) == 1
    assert main(["show", "--html", str(run)]) == 2
    assert "holds none of report.html, posterior.html, next.html, run.html" in capsys.readouterr().err


def test_of_a_recording_cut_within_a_message_a_whole_copy_is_opened(run, started):
    for path in run.glob("run-*.rrd"):
        path.unlink()
    (run / "run.rrd").write_bytes(WHOLE + MESSAGE[:-1])
    assert main(["show", str(run)]) == 0
    copy = Path(started[1][0])
    assert copy.parent != run
    assert copy.read_bytes() == WHOLE
    assert (run / "run.rrd").read_bytes() == WHOLE + MESSAGE[:-1]
