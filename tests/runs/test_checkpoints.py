"""Checkpoints: whole or passed over, rotated, nothing lost when a save fails or the process is killed."""

from __future__ import annotations

import errno
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch

from onlinebayes.runs import BadInput, Checkpoints, RunFolder, random_state, set_random_state
from onlinebayes.runs.checkpoints import plain

STATE = {"weights": {"a": torch.arange(6.0).reshape(2, 3)}, "clock": [1, True, None], 3: "text", "pair": (1, 2.5)}


def same(first: object, second: object) -> bool:
    if isinstance(first, torch.Tensor):
        return torch.equal(first, second) and first.dtype == second.dtype
    if isinstance(first, dict):
        return first.keys() == second.keys() and all(same(first[key], second[key]) for key in first)
    if isinstance(first, list | tuple):
        return type(first) is type(second) and len(first) == len(second) and all(map(same, first, second))
    return first == second


def test_what_was_saved_is_loaded(tmp_path: Path) -> None:
    checkpoints = Checkpoints(tmp_path, "recipe")
    assert checkpoints.load() is None
    checkpoints.save(STATE)
    found = checkpoints.load()
    assert found.number == 1
    assert same(found.state, STATE)


def test_the_last_ones_are_kept_and_no_temporary_file_is_left(tmp_path: Path) -> None:
    checkpoints = Checkpoints(tmp_path, "recipe", keep=2)
    (tmp_path / ".checkpoint-000001-abc.pt").write_bytes(b"left by a kill")
    for i in range(5):
        checkpoints.save({"i": i})
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        f"checkpoint-{n:06d}.{kind}" for n in (4, 5) for kind in ("json", "pt")
    ]
    assert checkpoints.load().state == {"i": 4}


@pytest.mark.parametrize("value", [object(), {1.5: 2}, {"a": [torch.nn.Linear(1, 1)]}, {"f": len}])
def test_what_is_no_plain_value_is_refused_by_its_place(value: object) -> None:
    with pytest.raises(TypeError, match="state"):
        plain(value)


def test_numpy_values_become_plain() -> None:
    state = plain({"n": np.float64(1.5), "x": np.arange(3)})
    assert same(state, {"n": 1.5, "x": torch.arange(3)})


@pytest.mark.parametrize("damage", ["truncate", "flip", "no json", "foreign", "version", "not a dict"])
def test_a_damaged_checkpoint_is_passed_over_in_one_line(
    damage: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    checkpoints = Checkpoints(tmp_path, "recipe")
    checkpoints.save({"i": 1})
    newest = checkpoints.save({"i": 2})
    manifest = newest.with_suffix(".json")
    if damage == "truncate":
        newest.write_bytes(newest.read_bytes()[:-7])
    elif damage == "flip":
        content = bytearray(newest.read_bytes())
        content[len(content) // 2] ^= 1
        newest.write_bytes(bytes(content))
    elif damage == "no json":
        manifest.write_text("{")
    elif damage == "foreign":
        manifest.write_text(manifest.read_text().replace('"recipe": "recipe"', '"recipe": "other"'))
    elif damage == "version":
        manifest.write_text(manifest.read_text().replace('"format": 1', '"format": 99'))
    else:
        manifest.write_text("[]")
    assert checkpoints.load().state == {"i": 1}
    told = capsys.readouterr().err
    assert len(told.splitlines()) == 1
    assert "the one before it is tried" in told


def test_no_whole_checkpoint_is_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    checkpoints = Checkpoints(tmp_path, "recipe")
    checkpoints.save({"i": 1}).write_bytes(b"")
    with pytest.raises(BadInput, match="none of 1 checkpoints is whole"):
        checkpoints.load()


@pytest.mark.parametrize("function", ["fsync", "replace"])
def test_a_full_disk_leaves_what_was_there(function: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    checkpoints = Checkpoints(tmp_path, "recipe")
    checkpoints.save({"i": 1})
    before = sorted(path.name for path in tmp_path.iterdir())

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os if function == "fsync" else Path, function, full)
    with pytest.raises(BadInput, match="No space left"):
        checkpoints.save({"i": 2})
    monkeypatch.undo()
    assert sorted(path.name for path in tmp_path.iterdir()) == before
    assert checkpoints.load().state == {"i": 1}


SAVING = """
import sys, torch
from onlinebayes.runs import Checkpoints
checkpoints = Checkpoints(sys.argv[1], "recipe")
for i in range(10_000):
    checkpoints.save({"i": i, "x": torch.full((20_000,), float(i))})
    print(i, flush=True)
"""


def test_a_kill_at_any_moment_loses_nothing_that_was_saved(tmp_path: Path) -> None:
    """Six kills at random moments of a process that does nothing but save."""
    moments = random.Random(0)
    for k in range(6):
        folder = tmp_path / str(k)
        folder.mkdir()
        command = [sys.executable, "-c", SAVING, str(folder)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            process.stdout.readline()
            time.sleep(moments.uniform(0.0, 0.05))
            process.send_signal(signal.SIGKILL)
            saved = [0, *map(int, process.stdout.read().split())][-1]
        found = Checkpoints(folder, "recipe").load().state
        assert found["i"] >= saved
        assert (found["x"] == found["i"]).all()


def test_random_numbers_go_on_where_they_stood() -> None:
    state = plain(random_state())
    first = [random.random(), np.random.rand(), torch.rand(()).item(), random.gauss(0, 1)]
    set_random_state(state)
    assert [random.random(), np.random.rand(), torch.rand(()).item(), random.gauss(0, 1)] == first


# --- run folders -----------------------------------------------------------------------------------------------------


def test_one_process_at_a_time_holds_a_folder(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom onlinebayes.runs import RunFolder\n"
        "with RunFolder(sys.argv[1], 'recipe'):\n    print('held', flush=True)\n    sys.stdin.read()"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "held\n"
        with pytest.raises(BadInput, match=f"in use by process {process.pid}"), RunFolder(tmp_path, "recipe"):
            pass
        process.kill()
    with RunFolder(tmp_path, "recipe") as folder:
        assert folder.path("log.csv") == tmp_path / "log.csv"


def test_a_folder_of_another_run_is_refused(tmp_path: Path) -> None:
    with RunFolder(tmp_path / "run", "pendulum", settings={"seed": 1}):
        pass
    with RunFolder(tmp_path / "run", "pendulum", settings={"seed": 1}):
        pass
    with pytest.raises(BadInput, match="holds a run of 'pendulum', not of 'cartpole'"):
        RunFolder(tmp_path / "run", "cartpole").__enter__()
    with pytest.raises(BadInput, match=r"begun with seed = 1 \(now 2\)"):
        RunFolder(tmp_path / "run", "pendulum", settings={"seed": 2}).__enter__()
    (tmp_path / "run" / "run.json").write_text("nonsense")
    with pytest.raises(BadInput, match=r"run\.json cannot be read"):
        RunFolder(tmp_path / "run", "pendulum").__enter__()


def test_a_file_or_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="is a file"):
        RunFolder(tmp_path / "file", "recipe").__enter__()
    with pytest.raises(BadInput, match="cannot write here"):
        RunFolder(tmp_path / "file" / "below", "recipe").__enter__()
