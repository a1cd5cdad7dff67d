"""A run folder is held by one process at a time, and by runs of one kind."""

from __future__ import annotations

import errno
import fcntl
import os
import stat
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from onlinebayes.runs import BadInput, Lock, RunFolder

HOLDING = """
import os, sys, time
from onlinebayes.runs import RunFolder
with RunFolder(sys.argv[1], "recipe"):
    if sys.argv[2] == "fork" and os.fork() == 0:
        print(os.getpid(), flush=True)
        time.sleep(60)
        os._exit(0)
    if sys.argv[2] == "alone":
        print(os.getpid(), flush=True)
    sys.stdin.read()
"""


@contextmanager
def holder(folder: Path, how: str) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """A process that holds the folder, and the number that it printed; killed at the end."""
    command = [sys.executable, "-c", HOLDING, str(folder), how]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process, int(process.stdout.readline())
        finally:
            process.kill()


def test_one_process_at_a_time_holds_a_folder_and_a_kill_frees_it(tmp_path: Path) -> None:
    with holder(tmp_path, "alone") as (process, _):
        told = rf"in use by process {process.pid}, since 20\d\d-\d\d-\d\d \d\d:\d\d:\d\d"
        with pytest.raises(BadInput, match=told) as error, RunFolder(tmp_path, "recipe"):
            pass
        assert "\n" not in str(error.value)
    with RunFolder(tmp_path, "recipe") as folder:
        assert folder.path("log.csv") == tmp_path / "log.csv"


def test_a_child_that_outlives_the_killed_process_does_not_hold_on(tmp_path: Path) -> None:
    with holder(tmp_path, "fork") as (process, child):
        with pytest.raises(BadInput, match=f"in use by process {process.pid}"):
            RunFolder(tmp_path, "recipe").__enter__()
        process.kill()
        process.wait()
        os.kill(child, 0)  # it lives
        with RunFolder(tmp_path, "recipe"):
            os.kill(child, 9)


def test_the_same_process_holds_it_once(tmp_path: Path) -> None:
    with RunFolder(tmp_path, "recipe"):
        with pytest.raises(BadInput, match=f"in use by process {os.getpid()}"):
            RunFolder(tmp_path, "recipe").__enter__()
        with pytest.raises(BadInput, match="in use by"):
            RunFolder(tmp_path, "recipe").__enter__()
    with RunFolder(tmp_path, "recipe"):
        pass


def test_what_a_kill_left_half_written_is_removed(tmp_path: Path) -> None:
    (tmp_path / ".partial-run-abc.rrd").write_bytes(b"half")
    (tmp_path / ".notes").write_text("mine")
    with RunFolder(tmp_path, "recipe"):
        assert sorted(path.name for path in tmp_path.iterdir()) == [".lock", ".notes", "run.json"]


def test_a_folder_of_another_run_is_refused(tmp_path: Path) -> None:
    with RunFolder(tmp_path / "run", "pendulum", settings={"seed": 1}):
        pass
    with RunFolder(tmp_path / "run", "pendulum", settings={"seed": 1}):
        pass
    with pytest.raises(BadInput, match="holds a run of 'pendulum', not of 'cartpole'"):
        RunFolder(tmp_path / "run", "cartpole").__enter__()
    with pytest.raises(BadInput, match=r"begun with seed = 1 \(now 2\)"):
        RunFolder(tmp_path / "run", "pendulum", settings={"seed": 2}).__enter__()
    for content in ["nonsense", "[]", '{"recipe": "pendulum"}', '{"recipe": "pendulum", "settings": 3}']:
        (tmp_path / "run" / "run.json").write_text(content)
        with pytest.raises(BadInput, match=r"run\.json cannot be read"):
            RunFolder(tmp_path / "run", "pendulum").__enter__()


def test_a_refused_folder_is_not_held(tmp_path: Path) -> None:
    with RunFolder(tmp_path, "pendulum"):
        pass
    with pytest.raises(BadInput):
        RunFolder(tmp_path, "cartpole").__enter__()
    with RunFolder(tmp_path, "pendulum"):
        pass


def test_a_file_or_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="is a file"):
        RunFolder(tmp_path / "file", "recipe").__enter__()
    with pytest.raises(BadInput, match="cannot write here"):
        RunFolder(tmp_path / "file" / "below", "recipe").__enter__()


def test_a_read_only_folder_is_refused_before_the_run_begins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Made by hand where the tests run as root, who may write everywhere."""
    folder = tmp_path / "run"
    with RunFolder(folder, "recipe"):
        pass
    folder.chmod(stat.S_IRUSR | stat.S_IXUSR)
    if os.access(folder, os.W_OK):
        monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(BadInput, match="cannot write here"):
        RunFolder(folder, "recipe").__enter__()
    monkeypatch.undo()
    folder.chmod(0o755)
    read_only = OSError(errno.EROFS, os.strerror(errno.EROFS))
    monkeypatch.setattr(os, "open", lambda *_: (_ for _ in ()).throw(read_only))
    with pytest.raises(BadInput, match="cannot write here: Read-only file system"):
        RunFolder(folder, "recipe").__enter__()


def test_a_file_system_without_locks_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", none)
    with pytest.raises(BadInput, match="cannot be locked: No locks available; choose one on a local disk"):
        RunFolder(tmp_path, "recipe").__enter__()


def test_a_full_disk_does_not_keep_a_run_from_its_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    first, second = Lock(tmp_path / ".lock"), Lock(tmp_path / ".lock")
    monkeypatch.setattr(os, "write", full)
    first.acquire()
    with pytest.raises(BadInput, match="in use by another process"):
        second.acquire()
    first.release()
    first.release()
    second.acquire()
    second.release()
