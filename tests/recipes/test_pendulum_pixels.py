"""A pendulum seen by a camera: the reader learns, is kept, and a run does not depend on whether it was."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import pytest
import torch

from envs.pendulum import Pendulum, PendulumTask
from onlinebayes.experiments import run
from onlinebayes.inference import BoxUniform
from onlinebayes.runs import seed_everything
from onlinebayes.trainers import Problem
from onlinebayes.transforms import ParameterRandomization
from recipes.pendulum import SPACE
from recipes.pendulum_pixels import FilmedSettings, FrameReader, build, filmed, read_by, teach

FIGURES = ("figure/return", "figure/log density of the truth")


@pytest.mark.slow
def test_the_reader_learns_and_stands_in_for_the_sensors() -> None:
    seed_everything(0)
    plain = Problem(Pendulum(SPACE), PendulumTask(), BoxUniform(SPACE))
    problem, reader = filmed(plain, 5), FrameReader()
    before = wrong(problem, reader)
    teach(reader, problem, 6, 7)
    assert wrong(problem, reader) < 0.6 * before
    env = problem.worlds(4, ParameterRandomization(problem.prior), 11).append_transform(read_by(reader))
    told = env.rollout(3, break_when_any_done=False)["next"]
    assert torch.allclose(told["observation"], reader(told["pixels"]), atol=1e-5)


def wrong(problem: Problem, reader: FrameReader) -> float:
    """Error of cos and sin in frames that the reader has not learnt from."""
    env = problem.worlds(16, ParameterRandomization(problem.prior), 11)
    seen = env.rollout(10, break_when_any_done=False)["next"]
    with torch.no_grad():
        return float((reader(seen["pixels"]) - seen["observation"])[..., :2].square().mean().sqrt())


@pytest.mark.long
def test_a_run_is_the_same_with_a_reader_that_was_kept(tmp_path: Path) -> None:
    settings = FilmedSettings(short=True, out=str(tmp_path))
    place, logs = tmp_path / "pendulum_pixels-online-0-short", []
    for _ in range(2):
        assert run("pendulum_pixels", build, settings) in (0, 1)  # three rollouts teach a reader next to nothing
        with (place / "log.csv").open(encoding="utf-8", newline="") as file:
            logs.append([[row[name] for name in FIGURES] for row in csv.DictReader(file)])
        shutil.rmtree(place)
    assert len([*tmp_path.glob("pendulum_pixels-reader-*")]) == 1
    assert len(logs[0]) == 2
    assert logs[0] == logs[1]
