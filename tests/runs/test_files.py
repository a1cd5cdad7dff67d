"""A file is whole or not there, and a folder that cannot be written is bad input."""

from __future__ import annotations

import errno
import os
import stat

import pytest

from onlinebayes.runs import Attempts, BadInput, DiskFull, atomic_path, together, write_atomic
from onlinebayes.runs.files import remove_partial


def test_text_and_bytes_arrive_whole(tmp_path):
    write_atomic(tmp_path / "deep" / "a.txt", "naïve")
    write_atomic(tmp_path / "b.bin", b"\x00\xff")
    assert (tmp_path / "deep" / "a.txt").read_text(encoding="utf-8") == "naïve"
    assert (tmp_path / "b.bin").read_bytes() == b"\x00\xff"


def test_a_failure_keeps_the_old_file_and_leaves_nothing_else(tmp_path):
    write_atomic(tmp_path / "a.txt", "old")

    def fails() -> None:
        with atomic_path(tmp_path / "a.txt") as temporary:
            temporary.write_text("half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fails()
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"


def test_the_permissions_are_those_of_an_ordinary_file(tmp_path):
    write_atomic(tmp_path / "a.txt", "")
    (tmp_path / "ordinary").touch()
    assert stat.S_IMODE(os.stat(tmp_path / "a.txt").st_mode) == stat.S_IMODE(os.stat(tmp_path / "ordinary").st_mode)


def test_a_file_in_the_way_is_bad_input(tmp_path):
    (tmp_path / "taken").write_text("mine")
    with pytest.raises(BadInput, match="cannot write here"):
        write_atomic(tmp_path / "taken" / "a.txt", "")


def test_the_message_is_one_line_of_place_problem_cure():
    assert str(BadInput("x is\n3", "use 4", where="a.csv")) == "a.csv: x is 3; use 4"
    assert str(BadInput("x")) == "x"


def test_a_full_disk_is_one_line_and_keeps_the_old_file(tmp_path, monkeypatch):
    write_atomic(tmp_path / "a.txt", "old")

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(BadInput, match=r"a\.txt: cannot be written: No space left on device; make room"):
        write_atomic(tmp_path / "a.txt", "new", durable=True)
    monkeypatch.undo()
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"


def test_an_error_of_another_file_keeps_its_own_words(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"missing\.csv"), atomic_path(tmp_path / "a.txt"):
        (tmp_path / "missing.csv").read_text()


def test_what_a_kill_left_is_removed(tmp_path):
    with atomic_path(tmp_path / "a.txt") as temporary:
        left = temporary.with_name(temporary.name + ".txt")
        left.write_text("half")
        (tmp_path / ".b").write_text("")
    remove_partial(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [".b", "a.txt"]


def test_a_pipe_is_not_replaced(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(BadInput, match="is a device or a pipe"):
        write_atomic(pipe, "text")
    assert pipe.is_fifo()


def test_files_written_together_appear_together(tmp_path):
    write_atomic(tmp_path / "b.txt", "old")
    with together():
        write_atomic(tmp_path / "a.txt", "1")
        write_atomic(tmp_path / "a.txt", "2")
        write_atomic(tmp_path / "b.txt", "new")
        assert not (tmp_path / "a.txt").exists()
        assert (tmp_path / "b.txt").read_text() == "old"
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"a.txt": "2", "b.txt": "new"}


def test_a_disk_that_fills_leaves_what_was_there(tmp_path, monkeypatch):
    """The second file finds no room: none of them appears, and no attempt takes it for a part that may fail."""
    write_atomic(tmp_path / "a.txt", "old")
    attempts = Attempts()

    def answer() -> None:
        with together():
            write_atomic(tmp_path / "a.txt", "new")
            with attempts.attempt("the second file"), atomic_path(tmp_path / "b.txt"):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(DiskFull, match=r"b\.txt: cannot be written: No space left on device; make room"):
        answer()
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"
    write_atomic(tmp_path / "a.txt", "after")  # nothing waits any more
    assert (tmp_path / "a.txt").read_text() == "after"
