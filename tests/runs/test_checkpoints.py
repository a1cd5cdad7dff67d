"""Checkpoints: whole or passed over, rotated, nothing lost when a save fails or the process is killed."""

from __future__ import annotations

import errno
import hashlib
import io
import json
import os
import random
import shutil
import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
import torch

from onlinebayes.runs import BadInput, Checkpoints

STATE = {"weights": {"a": torch.arange(6.0).reshape(2, 3)}, "clock": [1, True, None], 3: "text", "pair": (1, 2.5)}


def same(first: object, second: object) -> bool:
    if isinstance(first, torch.Tensor):
        return torch.equal(first, second) and first.dtype == second.dtype
    if isinstance(first, dict):
        return first.keys() == second.keys() and all(same(first[key], second[key]) for key in first)
    if isinstance(first, list | tuple):
        return type(first) is type(second) and len(first) == len(second) and all(map(same, first, second))
    return first == second


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_what_was_saved_is_loaded(tmp_path: Path) -> None:
    checkpoints = Checkpoints(tmp_path, "recipe")
    assert checkpoints.load() is None
    path = checkpoints.save(STATE)
    found = checkpoints.load()
    assert (found.number, found.path) == (1, path)
    assert same(found.state, STATE)
    assert same(torch.load(path, weights_only=True), STATE)
    told = json.loads(path.with_suffix(".json").read_text())
    assert told["bytes"] == path.stat().st_size
    assert told["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert told["versions"]["torch"] == version("torch")


def test_the_last_ones_are_kept_and_other_files_left_alone(tmp_path: Path) -> None:
    checkpoints = Checkpoints(tmp_path, "recipe", keep=2)
    mine = ["checkpoint-best.pt", "checkpoint-000001 copy.json", "checkpoint-000099.pt", "policy.pt"]
    for name in mine:
        (tmp_path / name).write_bytes(b"of the user")
    (tmp_path / "checkpoint-000001.pt").write_bytes(b"never whole: killed before its manifest")
    for i in range(5):
        checkpoints.save({"i": i})
    kept = [f"checkpoint-{n:06d}.{kind}" for n in (4, 5) for kind in ("json", "pt")]
    assert names(tmp_path) == sorted(kept + mine)
    assert checkpoints.load().state == {"i": 4}


def test_a_damaged_checkpoint_does_not_push_a_whole_one_out(tmp_path: Path) -> None:
    checkpoints = Checkpoints(tmp_path, "recipe", keep=2)
    checkpoints.save({"i": 1})
    for i in (2, 3):
        checkpoints.save({"i": i})
    (tmp_path / "checkpoint-000003.pt").write_bytes(b"")
    checkpoints.save({"i": 4})
    (tmp_path / "checkpoint-000004.pt").write_bytes(b"")
    assert checkpoints.load().state == {"i": 2}


def test_more_than_a_million_are_still_in_order(tmp_path: Path) -> None:
    checkpoints = Checkpoints(tmp_path, "recipe", keep=2)
    first = checkpoints.save({"i": 1})
    for suffix in (".pt", ".json"):
        first.with_suffix(suffix).rename(tmp_path / f"checkpoint-999999{suffix}")
    checkpoints.save({"i": 2})
    assert checkpoints.load().number == 1_000_000


def other(key: str, value: object) -> Callable[[Path], None]:
    """Damage of the manifest: another value."""

    def change(path: Path) -> None:
        manifest = path.with_suffix(".json")
        manifest.write_text(json.dumps({**json.loads(manifest.read_text()), key: value}))

    return change


def replaced(content: bytes) -> Callable[[Path], None]:
    """Damage of the file that the manifest does not know of."""

    def change(path: Path) -> None:
        path.write_bytes(content)
        other("bytes", len(content))(path)
        other("sha256", hashlib.sha256(content).hexdigest())(path)

    return change


def with_code() -> bytes:
    file = io.BytesIO()
    torch.save({"run me": Path("x")}, file)
    return file.getvalue()


def flipped(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(bytes(content))


DAMAGE = {
    "truncated": (lambda path: path.write_bytes(path.read_bytes()[:-7]), "is damaged: .* bytes of"),
    "flipped": (flipped, "is damaged: its checksum is another"),
    "gone": (lambda path: path.unlink(), "cannot be read: .*No such file"),
    "manifest": (lambda path: path.with_suffix(".json").write_bytes(b"\xff{"), "cannot be read"),
    "empty manifest": (lambda path: path.with_suffix(".json").write_text(""), "cannot be read"),
    "no dict": (lambda path: path.with_suffix(".json").write_text("[]"), "of another format than 1"),
    "foreign": (other("recipe", "other"), "is of 'other', not of 'recipe'"),
    "version": (other("format", 99), "of another format than 1"),
    "not torch's": (replaced(b"something else"), "torch cannot read the checkpoint"),
    "with code": (replaced(with_code()), "torch cannot read the checkpoint"),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_checkpoint_is_passed_over_in_one_line(
    damage: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change, told = DAMAGE[damage]
    checkpoints = Checkpoints(tmp_path, "recipe")
    checkpoints.save({"i": 1})
    change(checkpoints.save({"i": 2}))
    assert checkpoints.load().state == {"i": 1}
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(str(tmp_path / "checkpoint-000002.pt"))
    assert line.endswith("; checkpoint-000001.pt is used instead")
    with pytest.raises(BadInput, match=told):
        checkpoints._read(2, "cpu")
    assert checkpoints.save({"i": 3}).name == "checkpoint-000003.pt"
    assert checkpoints.load().state == {"i": 3}


def test_a_file_cut_anywhere_is_passed_over(tmp_path: Path) -> None:
    checkpoints = Checkpoints(tmp_path, "recipe")
    checkpoints.save({"i": 1})
    newest = checkpoints.save({"i": 2, "x": torch.rand(100)})
    whole = {suffix: newest.with_suffix(suffix).read_bytes() for suffix in (".pt", ".json")}
    cuts = random.Random(0)
    for suffix, content in whole.items():
        for _ in range(100):
            newest.with_suffix(suffix).write_bytes(content[: cuts.randrange(len(content) - 1)])
            assert checkpoints.load().state == {"i": 1}
        newest.with_suffix(suffix).write_bytes(content)
    assert checkpoints.load().number == 2


def test_no_whole_checkpoint_is_bad_input_in_one_line(tmp_path: Path) -> None:
    checkpoints = Checkpoints(tmp_path, "recipe")
    for path in [checkpoints.save({"i": i}) for i in range(2)]:
        path.write_bytes(b"")
    with pytest.raises(BadInput, match=r"none of 2 checkpoints can be used; the newest: .*000002.pt.*damaged") as error:
        checkpoints.load()
    assert "\n" not in str(error.value)


def test_what_cannot_be_saved_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match=r"state\.policy is a Linear"):
        Checkpoints(tmp_path, "recipe").save({"policy": torch.nn.Linear(1, 1)})
    assert names(tmp_path) == []


# --- a full disk -----------------------------------------------------------------------------------------------------


class FullDisk:
    """Fails a function, and everything after it, from its n-th call on."""

    def __init__(self, function: Callable[..., Any], after: int) -> None:
        self.function, self.left = function, after

    def __call__(self, *args: Any) -> Any:
        self.left -= 1
        if self.left < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return self.function(*args)


@pytest.mark.parametrize(("function", "after"), [*(("fsync", i) for i in range(4)), ("replace", 0), ("replace", 1)])
def test_a_full_disk_leaves_what_was_there(
    function: str, after: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A save brings four things to the disk (two files, their names twice) and renames two."""
    checkpoints = Checkpoints(tmp_path, "recipe")
    checkpoints.save({"i": 1})
    before = names(tmp_path)
    monkeypatch.setattr(os, function, FullDisk(getattr(os, function), after))
    with pytest.raises(BadInput, match="No space left on device; make room") as error:
        checkpoints.save({"i": 2})
    monkeypatch.undo()
    assert "\n" not in str(error.value)
    assert names(tmp_path) == before
    assert checkpoints.load().state == {"i": 1}
    assert checkpoints.save({"i": 3}).name == "checkpoint-000002.pt"


LIMITED = """
import resource, sys, torch
from onlinebayes.runs import BadInput, Checkpoints
checkpoints = Checkpoints(sys.argv[1], "recipe")
checkpoints.save({"i": 1})
for limit in [0, 1, 500, 4096, 70_000, 399_000, 401_000]:
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    try:
        checkpoints.save({"i": 2, "x": torch.zeros(100_000)})
    except BadInput as error:
        print(error, flush=True)
"""


def test_a_file_that_cannot_grow_is_one_line_wherever_it_stops(tmp_path: Path) -> None:
    """The system's own limit on the size of a file stands in for the end of a disk."""
    command = [sys.executable, "-c", LIMITED, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert len(done.stdout.splitlines()) == 7
    assert all("cannot be written: File too large" in line for line in done.stdout.splitlines())
    assert done.stderr == ""
    assert names(tmp_path) == ["checkpoint-000001.json", "checkpoint-000001.pt"]
    assert Checkpoints(tmp_path, "recipe").load().state == {"i": 1}


def test_saving_takes_no_second_copy_in_memory(tmp_path: Path) -> None:
    state = {"x": torch.zeros(5_000_000)}
    tracemalloc.start()
    Checkpoints(tmp_path, "recipe").save(state)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 5_000_000, "of 20 MB"


# --- kills -----------------------------------------------------------------------------------------------------------

KILLED = """
import os, random, signal, sys, time
from pathlib import Path
import torch
from onlinebayes.runs import RunFolder

torch.set_num_threads(1)
moments = random.Random(0)

def save_without_end(folder, out):
    with RunFolder(folder, "recipe") as run:
        found = run.checkpoints.load()
        i = 0 if found is None else found.state["i"]
        while True:
            i += 1
            run.checkpoints.save({"i": i, "x": torch.full((20_000,), float(i))})
            os.write(out, b"%d\\n" % i)

for k in range(20):
    out, into = os.pipe()
    child = os.fork()
    if child == 0:
        save_without_end(sys.argv[1], into)
    os.close(into)
    saved = os.read(out, 100)
    time.sleep(moments.uniform(0.0, 0.03))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    while more := os.read(out, 10_000):
        saved += more
    os.close(out)
    last = int(saved.split()[-1])
    with RunFolder(sys.argv[1], "recipe") as run:
        found = run.checkpoints.load().state
        left = [path.name for path in Path(sys.argv[1]).iterdir() if path.name.startswith(".partial")]
    assert found["i"] in (last, last + 1), (k, found["i"], last)
    assert (found["x"] == found["i"]).all()
    assert left == []
print(last)
"""


def test_twenty_kills_at_random_moments_lose_nothing_that_was_saved(tmp_path: Path) -> None:
    """Of a process that does nothing but save; each goes on where the one before was killed."""
    done = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert int(done.stdout) >= 20


def test_a_copied_folder_goes_on(tmp_path: Path) -> None:
    Checkpoints(tmp_path / "a", "recipe").save({"i": 1})
    shutil.copytree(tmp_path / "a", tmp_path / "b")
    assert Checkpoints(tmp_path / "b", "recipe").load().state == {"i": 1}
