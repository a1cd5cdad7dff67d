"""What the commands write, print and return, around a result made by hand; opening a report; stopping."""

from __future__ import annotations

import dataclasses
import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from onlinebayes.cli import show, work
from onlinebayes.cli.main import FILES, main, parser
from onlinebayes.criticism import Criticism
from onlinebayes.problems import commands
from onlinebayes.runs import Stages
from tests.report.synthetic import criticism, drive


@pytest.fixture(scope="module")
def result() -> Criticism:
    return criticism(rate=50.0, seconds=2.0, simulator=drive())


def arguments(command: str, folder: Path, *more: str) -> list[str]:
    return [command, str(folder / "carriage.toml"), "--out", str(folder / "out" / "here"), *more]


@pytest.mark.parametrize("command", ["compare", "diagnose", "refine"])
def test_a_command_writes_its_files_and_says_what_it_found(folder, capsys, monkeypatch, result, command):
    verdict = "unexplained" if command == "compare" else result.verdict
    made = dataclasses.replace(result, command=command, verdict=verdict)
    monkeypatch.setattr(work, "criticise", lambda _command, _problem, _budget: made)
    assert main(arguments(command, folder)) == 0
    out = folder / "out" / "here"
    wanted = {"report.json", "report.html", "run.rrd"} | (
        {"refined.toml", "refined.xml"} if command == "refine" else set()
    )
    assert {path.name for path in out.iterdir()} == wanted
    printed = capsys.readouterr()
    assert printed.err == ""
    assert str(out / "report.html") in printed.out
    assert ("verdict:   missing_effect" in printed.out) == (command != "compare")
    assert ("verdict:   unexplained (with dry_friction@carriage," in printed.out) == (command == "compare")
    assert "missing:   dry_friction@carriage" in printed.out
    assert json.loads((out / "report.json").read_text())["holdout_looks"] == result.holdout_looks


def test_looks_at_the_held_out_runs_are_counted_for_each_folder(folder, monkeypatch, result):
    monkeypatch.setattr(
        work, "criticise", lambda _command, _problem, _budget: dataclasses.replace(result, holdout_looks=1)
    )
    report = folder / "out" / "here" / "report.json"
    for looks in (1, 2, 3):
        assert main(arguments("compare", folder)) == 0
        assert json.loads(report.read_text())["holdout_looks"] == looks
    for nonsense in ("", "[]", '{"holdout_looks": "many"}', '{"holdout_looks": true}', "\xff"):
        report.write_bytes(nonsense.encode("latin-1"))
        assert work.earlier_looks(report.parent) == 0


def test_a_folder_that_nothing_was_written_to_is_not_left_behind(folder, capsys, monkeypatch):
    def fails(*_arguments):
        assert (folder / "out" / "here").is_dir()
        raise ZeroDivisionError("a fault")

    monkeypatch.setattr(work, "criticise", fails)
    assert main(arguments("compare", folder)) == 1
    err = capsys.readouterr().err
    assert "Traceback" in err
    assert err.splitlines()[-1].startswith("onlinebayes: a fault of onlinebayes, not of your input")
    assert not (folder / "out").exists()


def test_ctrl_c_is_said_and_leaves_nothing(folder, capsys, monkeypatch):
    def stopped(*_arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(work, "criticise", stopped)
    assert main(arguments("compare", folder)) == 130
    assert capsys.readouterr().err == "onlinebayes: stopped by Ctrl-C\n"
    assert not (folder / "out").exists()


def test_a_search_that_was_stopped_still_reports(folder, capsys, monkeypatch, result):
    monkeypatch.setattr(
        work, "criticise", lambda _command, _problem, _budget: dataclasses.replace(result, interrupted=True)
    )
    assert main(arguments("refine", folder)) == 130
    assert (folder / "out" / "here" / "report.json").exists()
    assert "stopped before its end; the report holds what was found" in capsys.readouterr().err


def test_a_budget_reaches_the_search_and_nonsense_is_refused(folder, capsys, monkeypatch, result):
    given = []
    monkeypatch.setattr(work, "criticise", lambda _command, _problem, budget: given.append(budget) or result)
    assert main(arguments("refine", folder, "--budget", "40")) == 0
    assert main(arguments("refine", folder)) == 0
    assert given == [40.0, 300.0]
    for wrong in ("0", "-3", "soon", "inf"):
        capsys.readouterr()
        assert main(arguments("refine", folder, f"--budget={wrong}")) == 2
        assert f"{wrong} is no time: give seconds above 0" in capsys.readouterr().err
    assert main(arguments("compare", folder, "--budget", "20")) == 0
    assert given[-1] == 20.0
    assert main(["posterior", str(folder / "carriage.toml"), "--out", str(folder / "p"), "--budget", "20"]) == 2


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_keeps_what_is_known(folder, capsys, monkeypatch, result, number):
    """``timeout`` ends the work by SIGTERM: the report is written as after Ctrl-C."""

    def asked(*_given, interrupt, **_named):
        signal.raise_signal(number)
        return dataclasses.replace(result, interrupted=interrupt.requested)

    monkeypatch.setattr(commands, "refine", asked)
    assert main(arguments("refine", folder)) == 130
    assert (folder / "out" / "here" / "report.json").exists()
    assert "stopping with what is known" in capsys.readouterr().err


def test_a_stop_before_the_base_fit_is_said_and_leaves_nothing(folder, capsys, monkeypatch):
    monkeypatch.setattr(Stages, "__call__", lambda _stages, _line: signal.raise_signal(signal.SIGTERM))
    assert main(arguments("compare", folder)) == 130
    assert "stopped before the model was fitted; nothing is written" in capsys.readouterr().err
    assert not (folder / "out").exists()


def report_in(folder: Path, recording: bool = True) -> Path:
    (folder / "report.html").write_text("<p>report</p>")
    if recording:
        (folder / "run.rrd").write_bytes(b"")
    return folder


@pytest.mark.parametrize("recording", [True, False])
def test_show_without_a_screen_says_how(tmp_path, capsys, monkeypatch, recording):
    monkeypatch.setattr(show, "has_screen", lambda: False)
    monkeypatch.setattr(show.webbrowser, "open", lambda _url: pytest.fail("opened a browser"))
    assert main(["show", str(report_in(tmp_path, recording))]) == 0
    out = capsys.readouterr().out
    assert f"{tmp_path / 'report.html'}   (open it in a browser)" in out
    assert (f"rerun {tmp_path / 'run.rrd'}" in out) == recording


@pytest.mark.parametrize("works", [True, False])
def test_show_on_a_screen_opens_both_and_survives_when_it_cannot(tmp_path, capsys, monkeypatch, works):
    opened: list[str] = []

    def start(command, **_options):
        opened.append(command[1])
        if not works:
            raise FileNotFoundError(command[0])

    monkeypatch.setattr(show, "has_screen", lambda: True)
    monkeypatch.setattr(show.webbrowser, "open", lambda url: opened.append(url) or works)
    monkeypatch.setattr(show.subprocess, "Popen", start)
    assert main(["show", str(report_in(tmp_path))]) == 0
    assert opened == [(tmp_path / "report.html").as_uri(), str(tmp_path / "run.rrd")]
    assert ("open it in a browser" in capsys.readouterr().out) != works


@pytest.mark.parametrize(
    ("name", "value", "screen"), [("DISPLAY", ":0", True), ("WAYLAND_DISPLAY", "w", True), ("X", "", False)]
)
def test_a_screen_is_known_by_its_variables(monkeypatch, name, value, screen):
    monkeypatch.setattr(show.sys, "platform", "linux")
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv(name, value)
    assert show.has_screen() is screen


def test_help_and_version_are_quick_and_import_nothing_heavy():
    code = "import sys; from onlinebayes.cli.main import main; main(['--help']); print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout.splitlines()[-1] == "False"
    assert "onlinebayes refine carriage.toml --out" in done.stdout
    version = subprocess.run(
        [sys.executable, "-m", "onlinebayes.cli.main", "--version"], capture_output=True, text=True
    )
    assert version.stdout.startswith("onlinebayes 0.")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["compare", "p.toml", "--out", "x" * 300], "its name is too long for a file; give a shorter one"),
        (["init", "x" * 300, "log.csv", "--out", "p.toml"], "its name is too long for a file"),
        (["show", "x" * 300], "its name is too long for a file"),
        (["init", "drive.xml", "l\udcff.csv", "--out", "p.toml"], "its name is not UTF-8; rename it"),
    ],
)
def test_names_that_no_file_can_have_are_one_line(arguments, said, capsys, folder, monkeypatch) -> None:
    monkeypatch.chdir(folder)
    (folder / "p.toml").write_text((folder / "carriage.toml").read_text())
    assert main(arguments) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1


def test_a_recording_that_is_a_folder_is_not_offered(tmp_path: Path, capsys) -> None:
    (tmp_path / "report.html").write_text("<html></html>")
    (tmp_path / "run.rrd").mkdir()
    assert main(["show", str(tmp_path)]) == 0
    assert "recording:" not in capsys.readouterr().out


def test_a_shell_is_told_which_arguments_are_paths() -> None:
    (commands_,) = (action for action in parser()._actions if action.dest == "command")
    paths = {
        name: {action.dest for action in command._actions if getattr(action, "complete", None) == FILES}
        for name, command in commands_.choices.items()  # type: ignore[union-attr]
    }
    assert paths["refine"] == {"problem", "out"}
    assert paths["init"] == {"model", "logs", "out"}
    assert paths["check"] == {"folder", "logs", "out"}
    assert paths["show"] == {"out"}


def test_files_are_what_shtab_calls_them() -> None:
    assert pytest.importorskip("shtab").FILE == FILES
