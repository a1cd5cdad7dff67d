"""Recipes and studies on two Ray workers: what ends as it ends here, whoever is killed or stopped in the middle."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from onlinebayes.runs import BadInput, seed_everything
from onlinebayes.trainers import RealSystem
from onlinebayes.trainers.distributed import Here, OnRay, Workers
from recipes import cartpole, common, pendulum
from recipes.common import Run, Settings
from recipes.studies.resumable import each_kept_or_done
from recipes.studies.survival import differing, last

checked_elsewhere = pytest.mark.usefixtures("without_shape_checks")


def pid(_: int) -> int:
    return os.getpid()


@dataclass
class Killing:
    """In the place of the real system: kills a worker whenever it is asked."""

    real: RealSystem
    workers: Workers
    killed: list[int]

    def run(self, policy, steps):
        victim = max(dict(self.workers.work(pid, range(2))).values())
        assert victim != os.getpid()
        os.kill(victim, signal.SIGKILL)
        self.killed.append(victim)
        return self.real.run(policy, steps)


def with_killer(build, killed: list[int], settings: Settings) -> Run:
    made = build(settings)
    if isinstance(made.workers, OnRay):
        made = replace(made, trainer=replace(made.trainer, real=Killing(made.trainer.real, made.workers, killed)))
    return made


def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the parts of a run be worked on here, one after the other."""
    monkeypatch.setattr(common, "workers_of", lambda number: Here(number) if number else None)


def end(folder: Path, name: str) -> dict[str, Any]:
    """The last checkpoint, without Python's own random numbers: Ray draws from them, and nothing of ours does."""
    found = last(folder, name)
    del found["random"]["python"]
    return found


@pytest.mark.slow
@checked_elsewhere
def test_a_run_whose_workers_are_killed_ends_as_it_ends_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    killed: list[int] = []
    settings = Settings(short=True, ray_workers=2, out=str(tmp_path / "ray"))
    assert common.run("pendulum", partial(with_killer, pendulum.build, killed), settings) == 0
    assert len(killed) == 2, "one in each outer step"
    here(monkeypatch)
    assert common.run("pendulum", pendulum.build, replace(settings, out=str(tmp_path / "here"))) == 0
    first, second = (end(tmp_path / where, "pendulum") for where in ("ray", "here"))
    assert differing(first, second) == []
    assert first["online"]["clock"][2:] == second["online"]["clock"][2:], "frames of the policy and of the belief"


def command(out: Path) -> list[str]:
    return [sys.executable, "-m", "recipes.cartpole", "--short", "--ray-workers", "2", "--out", str(out)]


@pytest.mark.slow
@checked_elsewhere
def test_a_run_that_is_stopped_ends_its_workers_and_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root, folder = Path(__file__).parents[2], tmp_path / "ray" / "cartpole-online-0-short"
    begun = subprocess.Popen(command(tmp_path / "ray"), cwd=root, start_new_session=True)
    until = time.monotonic() + 180
    while not list(folder.glob("checkpoint-*.json")) and time.monotonic() < until:
        time.sleep(0.05)
    os.killpg(begun.pid, signal.SIGINT)  # as a terminal does
    asked = time.monotonic()
    assert begun.wait(60) == 130
    assert time.monotonic() - asked < 30
    assert of_session(begun.pid) == [], "nothing is left"
    assert subprocess.run(command(tmp_path / "ray"), cwd=root, timeout=200).returncode == 0
    here(monkeypatch)
    assert common.run("cartpole", cartpole.build, Settings(short=True, ray_workers=2, out=str(tmp_path / "here"))) == 0
    assert differing(end(tmp_path / "ray", "cartpole"), end(tmp_path / "here", "cartpole")) == []


def of_session(leader: int) -> list[str]:
    """Processes that are still there of those that a session leader started."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            name, values = stat.read_text().rsplit(")", 1)
        except OSError:
            continue
        state, _, _, session = values.split()[:4]
        if int(session) == leader and state != "Z":
            found.append(name)
    return found


def evaluated(file: Path | None, seed: int) -> dict[str, float]:
    """A study's job: an untrained policy's return. The first process to work on seed 2 dies of it."""
    if file is not None and seed == 2 and not file.exists():
        file.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    seed_everything(seed)
    made = pendulum.build(Settings(seed=seed))
    return {"return": made.problem.score(made.trainer.objective.policy, made.truth)}


@pytest.mark.slow
@checked_elsewhere
def test_a_study_whose_worker_is_killed_has_the_same_values(tmp_path: Path) -> None:
    seeds, fatal = (1, 2, 3), tmp_path / "fatal"
    local = each_kept_or_done("here", tmp_path / "here", {s: partial(evaluated, None, s) for s in seeds}, str)
    assert len(set(map(str, local.values()))) == 3
    jobs = {seed: partial(evaluated, fatal, seed) for seed in seeds}
    assert each_kept_or_done("ray", tmp_path / "ray", jobs, str, ray_workers=2) == local
    assert fatal.exists(), "somebody died"


def test_what_is_kept_is_not_done_again(tmp_path: Path) -> None:
    done: list[int] = []

    def job(number: int) -> dict[str, Any]:
        done.append(number)
        if number == 2:
            (tmp_path / "of 3.json").write_text('{"was": "done by another"}')
        return {"is": number}

    jobs = {number: partial(job, number) for number in (1, 2, 3)}
    (tmp_path / "of 1.json").write_text('{"was": "kept"}')
    found = each_kept_or_done("test", tmp_path, jobs, lambda number: f"of {number}")
    assert found == {1: {"was": "kept"}, 2: {"is": 2}, 3: {"was": "done by another"}}
    assert done == [2]


def test_without_ray_a_run_says_what_to_install(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setattr(sys, "argv", ["recipe", "--ray-workers", "2"])
    assert common.main("cartpole", cartpole.build, None) == 2
    assert capsys.readouterr().err == "Ray is not installed; pip install 'onlinebayes[ray]'\n"


def test_a_recipe_that_does_without_ray_says_so(tmp_path: Path) -> None:
    def build(settings: Settings) -> Run:
        return replace(pendulum.build(settings), workers=None)

    with pytest.raises(BadInput, match="leave out --ray-workers"):
        common.run("pendulum", build, Settings(short=True, ray_workers=2, out=str(tmp_path)))
    with pytest.raises(BadInput, match="give at least one of each"):
        Settings(ray_workers=-1)
