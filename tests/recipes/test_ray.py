"""Recipes and studies on two Ray workers: what ends as it ends here, whoever is killed or stopped in the middle."""

from __future__ import annotations

import csv
import os
import pickle
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cloudpickle
import pytest

from onlinebayes import experiments
from onlinebayes.experiments import Run, Settings
from onlinebayes.runs import BadInput, seed_everything
from onlinebayes.trainers.distributed import Here
from recipes import acrobot, cartpole, custom_gym, dm_control, mountain_car, pendulum, reach
from recipes.studies.jobs import each_kept_or_done

BUILDS = {
    "acrobot": acrobot.build,
    "cartpole": cartpole.build,
    "custom_gym": custom_gym.build,
    "dm_control": dm_control.build,
    "mountain_car": mountain_car.build,
    "pendulum": pendulum.build,
    "reach": reach.build,
}
SETTINGS = {"custom_gym": custom_gym.Settings, "dm_control": dm_control.Settings}
CASES = [pytest.param(name, marks=pytest.mark.slow if name == "dm_control" else ()) for name in sorted(BUILDS)]
checked_elsewhere = pytest.mark.usefixtures("without_shape_checks")


def travelled(it: Any) -> Any:
    """As a worker gets it."""
    return pickle.loads(cloudpickle.dumps(it))


class Travelling:
    """This process, in which everything travels as it does to Ray's workers."""

    number = 2

    def work(self, do, jobs):
        yield from ((i, travelled(do)(travelled(job))) for i, job in enumerate(jobs))

    def station(self, makes):
        ask = Here().station([travelled(make) for make in makes])
        return lambda questions: travelled(ask(travelled(questions)))

    def close(self) -> None:
        pass


@checked_elsewhere
@pytest.mark.parametrize("name", CASES)
def test_a_recipe_steps_its_worlds_in_parts(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("onlinebayes.experiments.settings.workers_of", lambda number: Travelling() if number else None)
    made = BUILDS[name](SETTINGS.get(name, Settings)(short=True, ray_workers=2))
    trainer = made.trainer
    trainer.collector.reset()
    assert trainer.objective.update(trainer.collector.next())
    groups = trainer.held_out.groups([trainer.objective.policy], made.problem.prior)
    assert len(groups["theta"].flatten(0, 2).unique(dim=0)) == len(groups) > 2
    made.close()


def command(out: Path) -> list[str]:
    return [sys.executable, "-m", "recipes.cartpole", "--short", "--ray-workers", "2", "--out", str(out)]


@pytest.mark.slow
def test_a_run_that_is_stopped_ends_its_workers_and_goes_on(tmp_path: Path) -> None:
    root, folder = Path(__file__).parents[2], tmp_path / "cartpole-online-0-short"
    begun = subprocess.Popen(command(tmp_path), cwd=root, start_new_session=True)
    until = time.monotonic() + 180
    while not list(folder.glob("checkpoint-*.json")) and time.monotonic() < until:
        time.sleep(0.05)
    os.killpg(begun.pid, signal.SIGINT)  # as a terminal does
    asked = time.monotonic()
    assert begun.wait(60) == 130
    assert time.monotonic() - asked < 30
    # A worker ends when it sees that its node has gone; on a busy machine that is after the run itself.
    until = time.monotonic() + 10
    while of_session(begun.pid) and time.monotonic() < until:
        time.sleep(0.1)
    assert of_session(begun.pid) == [], "nothing is left"
    ended = subprocess.run(command(tmp_path), cwd=root, timeout=240, capture_output=True, text=True, check=True)
    assert f"going on in {folder}" in ended.stdout
    with (folder / "log.csv").open() as file:
        assert [row["frames"] for row in csv.DictReader(file)] == ["8192", "16384"]


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


def test_without_ray_a_run_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setattr(sys, "argv", ["recipe", "--ray-workers", "2", "--out", str(tmp_path / "out")])
    assert experiments.main("cartpole", cartpole.build, None) == 2
    assert capsys.readouterr().err == "Ray is not installed; pip install 'onlinebayes[ray]'\n"
    assert not (tmp_path / "out").exists()


def test_a_recipe_that_does_without_ray_says_so(tmp_path: Path) -> None:
    def build(settings: Settings) -> Run:
        return replace(pendulum.build(settings), workers=None)

    with pytest.raises(BadInput, match="leave out --ray-workers"):
        experiments.run("pendulum", build, Settings(short=True, ray_workers=2, out=str(tmp_path)))
    with pytest.raises(BadInput, match="give at least one of each"):
        experiments.run("pendulum", pendulum.build, Settings(ray_workers=-1, out=str(tmp_path)))
