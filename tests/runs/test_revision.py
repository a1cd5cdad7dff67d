"""The commit that a table names."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from onlinebayes.runs import commit


def git(folder: Path, *words: str) -> str:
    identity = ("-c", "user.name=nobody", "-c", "user.email=nobody@example.org")
    command = ["git", "-C", str(folder), *identity, *words]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_a_commit_is_marked_where_code_was_changed_since(tmp_path: Path) -> None:
    file = tmp_path / "package" / "code.py"
    file.parent.mkdir()
    file.write_text("one = 1\n")
    git(tmp_path, "init", "-q")
    assert commit(file) is None  # the repository around it does not know it
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-q", "-m", "first")
    short = git(tmp_path, "rev-parse", "--short=8", "HEAD")
    assert commit(file) == short
    (tmp_path / "table.json").write_text("{}")
    assert commit(file) == short
    (tmp_path / "other.py").write_text("")
    assert commit(file) == f"{short}+"
    (tmp_path / "other.py").unlink()
    file.write_text("one = 2\n")
    assert commit(file) == f"{short}+"


def test_without_git_no_commit_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert commit() is None
