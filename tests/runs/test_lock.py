"""One process holds a lock; it ends with the process, however that ends."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from onlinebayes.runs import BadInput, Lock

HOLD = """
import sys, time
from onlinebayes.runs import Lock
lock = Lock(sys.argv[1])
lock.acquire()
print("held", flush=True)
time.sleep(60)
"""


@pytest.fixture
def holder(tmp_path: Path):
    process = subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path / "lock")], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.wait()
    process.stdout.close()


def test_another_process_is_named_and_a_killed_one_blocks_nobody(tmp_path: Path, holder) -> None:
    lock = Lock(tmp_path / "lock")
    with pytest.raises(BadInput, match=f"the folder is in use by process {holder.pid}, since .*; wait for it"):
        lock.acquire()
    holder.kill()
    holder.wait()
    lock.acquire()
    lock.release()


def test_a_lock_that_is_discarded_leaves_no_file_and_no_second_holder(tmp_path: Path) -> None:
    first, second = Lock(tmp_path / "lock"), Lock(tmp_path / "lock")
    first.acquire()
    first.discard()
    assert not list(tmp_path.iterdir())
    second.acquire()
    with pytest.raises(BadInput, match="in use"):
        first.acquire()
    second.discard()
    first.acquire()
    first.discard()
    first.discard()
