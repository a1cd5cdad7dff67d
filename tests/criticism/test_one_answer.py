"""One question has one answer: on any number of cores, with fits that were kept, after a kill at any moment."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from onlinebayes.criticism import Criticism, refine
from onlinebayes.parameters import Parameter
from onlinebayes.runs import FolderMemo, Kept, Memo
from onlinebayes.simulators.effects import ConstantLoad
from tests.criticism.rigs import measure, model

LOAD = ConstantLoad("rail", Parameter(-2.0, 2.0, "N"))
TRIED = ("constant_load",)


def asked(memo: Memo | None = None) -> Criticism:
    return refine(model(), measure({LOAD: (0.5,)}, runs=4, seconds=1.0), candidates=TRIED, memo=memo)


@pytest.fixture(scope="module")
def answer() -> Criticism:
    return asked()


def assert_same(one: Criticism, other: Criticism) -> None:
    """To the last bit."""
    assert one.verdict == other.verdict
    assert one.accepted == other.accepted == (LOAD.key,)
    assert one.parameters == other.parameters
    assert one.heldout_error == other.heldout_error
    assert one.notes == other.notes


class Killed(BaseException):
    """No error that anybody catches."""


class Mortal:
    """A memo whose process dies when the k-th answer has been kept."""

    def __init__(self, memo: FolderMemo, left: int) -> None:
        self.memo, self.left = memo, left

    def recall(self, key: str) -> Kept | None:
        return self.memo.recall(key)

    def keep(self, key: str, kept: Kept) -> None:
        self.memo.keep(key, kept)
        self.left -= 1
        if not self.left:
            raise Killed


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="copies are made on Linux alone")
def test_on_any_number_of_cores(monkeypatch: pytest.MonkeyPatch, answer: Criticism) -> None:
    monkeypatch.setenv("ONLINEBAYES_CORES", "3")
    assert_same(asked(), answer)


@pytest.mark.slow
def test_after_kills_and_with_what_was_kept(tmp_path: Path, answer: Criticism) -> None:
    kills = 0
    for left in (1, 1, 2, 3):
        try:
            asked(Mortal(FolderMemo(tmp_path), left))
        except Killed:
            kills += 1
    assert kills >= 3
    assert_same(asked(FolderMemo(tmp_path)), answer)
    kept = {path.name for path in tmp_path.iterdir()}
    assert_same(asked(FolderMemo(tmp_path)), answer)
    assert {path.name for path in tmp_path.iterdir()} == kept
