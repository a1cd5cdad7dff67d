"""Work side by side answers as work one by one does, whatever happens to a copy of the process."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from functools import partial

import pytest
import torch

from onlinebayes.runs import BadInput, Stopped, Watch, cores, processor_time, side_by_side
from onlinebayes.runs.interrupt import heed, heeding

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="copies are made on Linux alone")


@pytest.fixture(autouse=True)
def _three_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ONLINEBAYES_CORES", "3")


def _mine(k: int) -> tuple[int, int]:
    return k, os.getpid()


def test_answers_come_in_order_from_as_many_processes_as_there_are_cores() -> None:
    found = side_by_side([partial(_mine, k) for k in range(7)])
    assert [k for k, _ in found] == list(range(7))
    assert len({pid for _, pid in found}) == 3
    assert side_by_side([]) == []


def test_tensors_come_back_bit_for_bit() -> None:
    rows = torch.randn(50, 3, dtype=torch.float64)
    for found in side_by_side([partial(torch.matmul, rows.T, rows)] * 3):
        assert torch.equal(found, rows.T @ rows)


def test_one_core_makes_no_copy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ONLINEBAYES_CORES", "1")
    assert {pid for _, pid in side_by_side([partial(_mine, k) for k in range(4)])} == {os.getpid()}


def test_a_copy_makes_no_copies() -> None:
    def inner() -> tuple[int, set[int]]:
        return cores(), {pid for _, pid in side_by_side([partial(_mine, k) for k in range(4)])}

    mine, *others = side_by_side([inner] * 3)
    assert mine[0] == 3
    assert all(count == 1 and len(pids) == 1 for count, pids in others)


def test_a_thread_beside_the_main_one_makes_no_copy() -> None:
    found: list[tuple[int, int]] = []
    thread = threading.Thread(target=lambda: found.extend(side_by_side([partial(_mine, k) for k in range(3)])))
    thread.start()
    thread.join()
    assert {pid for _, pid in found} == {os.getpid()}


def test_an_error_in_a_copy_is_raised_here() -> None:
    def piece(k: int) -> int:
        if k == 1:
            raise BadInput(f"piece {k} is bad", "take another one")
        return k

    with pytest.raises(BadInput, match="piece 1 is bad; take another one"):
        side_by_side([partial(piece, k) for k in range(3)])


def test_what_a_copy_leaves_undone_is_done_here() -> None:
    here = os.getpid()

    def dies(k: int) -> int:
        if os.getpid() != here and k == 2:
            os.kill(os.getpid(), signal.SIGKILL)
        return k

    assert side_by_side([partial(dies, k) for k in range(6)]) == list(range(6))


def test_an_answer_that_cannot_be_sent_is_worked_out_here() -> None:
    found = side_by_side([lambda k=k: lambda: k for k in range(4)])
    assert [one() for one in found] == [0, 1, 2, 3]


class _Asked:
    requested = False


def test_a_stop_ends_the_copies_at_once() -> None:
    """They would sleep for a minute; the work here asks for a stop."""
    asking, here = _Asked(), os.getpid()

    def piece() -> None:
        if os.getpid() != here:
            time.sleep(60.0)
        asking.requested = True
        heed()

    began = time.monotonic()
    with heeding(asking), pytest.raises(Stopped):
        side_by_side([piece] * 3)
    assert time.monotonic() - began < 30.0


def test_processor_time_counts_copies_and_a_budget_holds_in_them() -> None:
    here = os.getpid()

    def busy() -> None:
        end = time.process_time() + 0.2
        while os.getpid() != here and time.process_time() < end:
            pass

    before = processor_time()
    side_by_side([busy] * 3)
    assert processor_time() - before > 0.3

    def endless() -> None:
        while os.getpid() != here:
            heed()

    with pytest.raises(Stopped), Watch().within(0.2).heeded():
        side_by_side([endless] * 3)


def test_a_copy_writes_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    side_by_side([partial(print, "said once", flush=True)] * 3)
    assert capfd.readouterr().out.count("said once") == 1
