"""What is kept comes back bit for bit; what is damaged, cannot be written or has no digest is worked out anew."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from onlinebayes.runs import FolderMemo, Kept, NoMemo, remembered, users_memo
from onlinebayes.runs.memo import FOLDER

KEPT = Kept({"rows": torch.randn(3, 4, dtype=torch.float64), "flag": torch.tensor(True)}, "two signs: ä, 7")


def test_what_is_kept_comes_back(tmp_path: Path) -> None:
    FolderMemo(tmp_path / "new").keep("key", KEPT)
    found = FolderMemo(tmp_path / "new").recall("key")
    assert found is not None
    assert found.text == KEPT.text
    assert all(torch.equal(found.tensors[name], rows) for name, rows in KEPT.tensors.items())
    assert FolderMemo(tmp_path / "new").recall("other") is None


@pytest.mark.parametrize("damage", [lambda b: b[: len(b) // 2], lambda b: b"", lambda b: b[:60] + b"?" + b[61:]])
def test_a_damaged_file_counts_as_not_there(tmp_path: Path, damage) -> None:
    FolderMemo(tmp_path).keep("key", KEPT)
    file = tmp_path / "key.npz"
    file.write_bytes(damage(file.read_bytes()))
    found = FolderMemo(tmp_path).recall("key")
    assert found is None or all(torch.equal(found.tensors[name], rows) for name, rows in KEPT.tensors.items())


def test_where_nothing_can_be_written_the_answer_stands(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    memo = FolderMemo(tmp_path / "file")
    assert _asked(memo, 2.0) == 4.0
    assert "not kept" in memo.problem
    assert len(memo.problem.splitlines()) == 1


def test_what_was_not_used_for_longest_goes_first(tmp_path: Path) -> None:
    size = 8 * 1000
    memo = FolderMemo(tmp_path, largest=4 * size)
    for k in range(6):
        memo.keep(str(k), Kept({"rows": torch.zeros(1000, dtype=torch.float64)}))
        memo.recall("0")
    assert memo.recall("0") is not None
    assert memo.recall("5") is not None
    assert memo.recall("1") is None
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 4 * size


def _asked(memo: FolderMemo | NoMemo, x: float, *, calls: list[float] | None = None, also: object = None) -> float:
    def make() -> float:
        if calls is not None:
            calls.append(x)
        return x * x

    pack, unpack = lambda y: Kept({"y": torch.tensor(y)}), lambda kept: float(kept.tensors["y"])
    return remembered(memo, ("square", x, also), make, pack, unpack)


def test_a_question_is_answered_once(tmp_path: Path) -> None:
    calls: list[float] = []
    memo = FolderMemo(tmp_path)
    assert [_asked(memo, x, calls=calls) for x in (2.0, 3.0, 2.0)] == [4.0, 9.0, 4.0]
    assert calls == [2.0, 3.0]
    assert _asked(NoMemo(), 2.0, calls=calls) == 4.0
    assert calls == [2.0, 3.0, 2.0]


def test_a_question_without_a_digest_is_always_worked_out(tmp_path: Path) -> None:
    calls: list[float] = []
    for _ in range(2):
        _asked(FolderMemo(tmp_path), 2.0, calls=calls, also=lambda: None)
    assert calls == [2.0, 2.0]
    assert not list(tmp_path.iterdir())


def test_the_users_memo_is_named_or_switched_off(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(FOLDER, "off")
    assert isinstance(users_memo(), NoMemo)
    monkeypatch.setenv(FOLDER, str(tmp_path / "mine"))
    mine = users_memo()
    assert isinstance(mine, FolderMemo)
    assert mine.folder == tmp_path / "mine"
    monkeypatch.delenv(FOLDER)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    users = users_memo()
    assert isinstance(users, FolderMemo)
    assert users.folder == tmp_path / "onlinebayes"
