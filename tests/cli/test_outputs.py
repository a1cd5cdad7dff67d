"""A command's folder: nothing that is read is written over, nothing stale stays, links are not written through."""

from __future__ import annotations

import dataclasses
import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from onlinebayes.cli import next as following
from onlinebayes.cli import work
from onlinebayes.cli.main import main
from onlinebayes.cli.outputs import writable
from onlinebayes.criticism import Criticism
from tests.report.synthetic import criticism, drive

REPORT = {"report.json", "report.html", "run.rrd"}


@pytest.fixture(scope="module")
def result() -> Criticism:
    return criticism(rate=50.0, seconds=2.0, simulator=drive())


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch, result: Criticism) -> None:
    """Commands that find at once what was found by hand."""
    monkeypatch.setattr(
        work, "criticise", lambda command, _problem, _budget: dataclasses.replace(result, command=command)
    )


def at_work(*_arguments: object) -> Criticism:
    raise AssertionError("the work was begun")


@pytest.mark.parametrize(
    ("command", "old", "new", "what"),
    [
        ("refine", "carriage.xml", "refined.xml", "the model"),
        ("refine", "carriage.toml", "refined.toml", "the problem file"),
        ("compare", "carriage.csv", "report.json", "a table of the problem"),
        ("next", "carriage.csv", "next.csv", "a table of the problem"),
    ],
)
def test_an_input_is_not_written_over(folder: Path, capsys, monkeypatch, command, old, new, what) -> None:
    """``--out`` names the folder in another way than the problem file does: the file is what counts."""
    for module in (work, following):
        monkeypatch.setattr(module, "criticise", at_work)
    (folder / old).rename(folder / new)
    problem = folder / ("refined.toml" if new == "refined.toml" else "carriage.toml")
    problem.write_text(problem.read_text().replace(old, new))
    (folder / "deeper").mkdir()
    before = {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    assert main([command, str(problem), "--out", str(folder / "deeper" / "..")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{new}: is {what}, and would be written over; choose another --out" in line
    assert {path: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before


@pytest.mark.parametrize(("out", "what"), [("carriage.xml", "the model"), ("carriage.csv", "a log")])
def test_init_does_not_write_over_what_it_reads(folder: Path, capsys, out: str, what: str) -> None:
    before = (folder / out).read_bytes()
    arguments = ["init", str(folder / "carriage.xml"), str(folder / "carriage.csv"), "--out", str(folder / out)]
    assert main([*arguments, "--force"]) == 2
    assert f"{out}: is {what}, and would be written over" in capsys.readouterr().err
    assert (folder / out).read_bytes() == before


def test_a_report_stands_beside_nothing_of_an_earlier_one(folder: Path, capsys, made: None) -> None:
    out = folder / "out"
    assert main(["refine", str(folder / "carriage.toml"), "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == {*REPORT, "refined.toml", "refined.xml"}
    (out / "refined.txt").write_text("mine")
    (out / "next.csv").write_text("mine")
    capsys.readouterr()
    assert main(["compare", str(folder / "carriage.toml"), "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == {*REPORT, "refined.txt", "next.csv"}
    said = "onlinebayes: taken away, as an earlier command left it: refined.toml, refined.xml\n"
    assert capsys.readouterr().err == said


def test_a_refined_problem_that_is_compared_in_its_own_folder_stays(folder: Path, made: None) -> None:
    out = folder / "out"
    assert main(["refine", str(folder / "carriage.toml"), "--out", str(out)]) == 0
    text = (out / "refined.toml").read_text()
    assert main(["compare", str(out / "refined.toml"), "--out", str(out)]) == 0
    assert (out / "refined.toml").read_text() == text


def test_what_was_there_stays_where_a_command_fails(folder: Path, monkeypatch, made: None) -> None:
    arguments = [str(folder / "carriage.toml"), "--out", str(folder / "out")]
    assert main(["refine", *arguments]) == 0
    before = {path.name for path in (folder / "out").iterdir()}
    monkeypatch.setattr(work, "criticise", at_work)
    assert main(["compare", *arguments]) == 1
    assert {path.name for path in (folder / "out").iterdir()} == before


@pytest.mark.parametrize("command", ["compare", "next"])
@pytest.mark.parametrize(
    ("out", "message"),
    [
        ("link", "{f}/link: is a link to {f}/real; give --out the folder itself"),
        ("dangling", "{f}/dangling: is a link to {f}/gone, which is not there; give --out the folder itself"),
        ("dangling/deeper", "{f}/dangling: is a link to {f}/gone, which is not there; give --out the folder itself"),
    ],
)
def test_an_out_folder_that_is_a_link(folder: Path, capsys, monkeypatch, command, out, message) -> None:
    for module in (work, following):
        monkeypatch.setattr(module, "criticise", at_work)
    (folder / "real").mkdir()
    (folder / "link").symlink_to("real")
    (folder / "dangling").symlink_to("gone")
    assert main([command, str(folder / "carriage.toml"), "--out", str(folder / out)]) == 2
    assert capsys.readouterr().err == f"onlinebayes: error: {message.format(f=folder)}\n"
    assert not list((folder / "real").iterdir())
    assert not (folder / "gone").exists()


def test_a_folder_within_a_linked_one_is_written(folder: Path, made: None) -> None:
    """A home that is a link is no surprise; nor is a folder that one makes there."""
    (folder / "real").mkdir()
    (folder / "link").symlink_to("real")
    assert main(["compare", str(folder / "carriage.toml"), "--out", str(folder / "link" / "out")]) == 0
    assert {path.name for path in (folder / "real" / "out").iterdir()} == REPORT


def test_a_folder_that_another_command_writes_to_is_refused(folder: Path, capsys, monkeypatch, made) -> None:
    out = folder / "out"
    with writable(out):
        assert main(["compare", str(folder / "carriage.toml"), "--out", str(out)]) == 2
        (line,) = [line for line in capsys.readouterr().err.splitlines() if "error" in line]
        assert f"{out}: the folder is in use by process {os.getpid()}, since" in line
    assert not out.exists()
    assert main(["compare", str(folder / "carriage.toml"), "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == REPORT


@pytest.mark.parametrize("full", ["report.html", "run.rrd", "report.json"])
def test_a_full_disk_is_one_line_and_leaves_the_report_before(folder: Path, capsys, monkeypatch, made, full) -> None:
    out = folder / "out"
    assert main(["compare", str(folder / "carriage.toml"), "--out", str(out)]) == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    capsys.readouterr()
    fill(monkeypatch, full)
    assert main(["compare", str(folder / "carriage.toml"), "--out", str(out)]) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "error" in line]
    assert f"{full}: cannot be written: No space left on device; make room" in line
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


NO_ROOM = """
import resource, signal, sys
from onlinebayes.cli import work
from onlinebayes.cli.main import main
from tests.report.synthetic import criticism, drive

result = criticism(rate=50.0, seconds=2.0, simulator=drive())
work.criticise = lambda *_: result
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, 150_000))
sys.exit(main(["compare", "carriage.toml", "--out", "out"]))
"""


@pytest.mark.slow
def test_nobody_else_speaks_where_a_recording_has_no_room(folder: Path) -> None:
    """Rerun's own writer told of the disk in lines of its own, and waited for ever where it ended while it wrote."""
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    environment.pop("RUST_LOG", None)
    done = subprocess.run(
        [sys.executable, "-c", NO_ROOM], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "run.rrd: cannot be written: File too large" in line


def fill(monkeypatch: pytest.MonkeyPatch, full: str) -> None:
    """From now on there is no room for a file of this name."""
    chmod = Path.chmod

    def filled(path: Path, mode: int) -> None:
        if path.name.startswith(f".partial-{Path(full).stem}-") and path.suffix == Path(full).suffix:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        chmod(path, mode)

    monkeypatch.setattr(Path, "chmod", filled)
