"""A replay that is no better than going on at the last velocity has no skill, and one of a right model has."""

from __future__ import annotations

from dataclasses import replace

import torch

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.discretisation import Discretisation
from onlinebayes.identification.fitting.window_length import windows_of
from onlinebayes.identification.judging.evaluator import Evaluation, Evaluator, FitRequest
from onlinebayes.identification.judging.hypothesis import Hypothesis
from onlinebayes.identification.judging.skill import gains_with_skill, naive_rms, unskilled
from onlinebayes.identification.replaying.integration import Integration
from tests.criticism.rigs import NOISE, measure, model

OWN = Integration(0.01)
SIMULATOR = model()
WINDOWS = windows_of(SIMULATOR, measure(runs=6, seconds=1.5), 0.5, torch.tensor([NOISE], dtype=torch.float64), OWN)


def evaluated(windows: Windows) -> tuple[Evaluation, Evaluator]:
    runs = tuple(f"run{k}" for k in range(6))
    evaluator = Evaluator(SIMULATOR, windows, runs, Discretisation(OWN, OWN))
    found = evaluator.evaluate(FitRequest(Hypothesis(), [{}]))
    assert found is not None
    return found, evaluator


def test_the_naive_continuation_leaves_what_is_no_line() -> None:
    time = torch.linspace(-1, 1, WINDOWS.rows, dtype=torch.float64)[None, :, None]
    for value, left in ((3 + 2 * time, 0.0), (3 + time**2, (time**2 - 1 / 3).square().mean().sqrt() / NOISE)):
        windows = replace(WINDOWS, value=value.expand_as(WINDOWS.value) + 0)
        rms = naive_rms(windows, ["qpos.rail"]) / windows.bin_rows**0.5
        torch.testing.assert_close(rms, torch.full_like(rms, float(left)), rtol=0.02, atol=1e-6)
    speeds = replace(WINDOWS, value=(3 + 0 * time).expand_as(WINDOWS.value) + 0)
    assert float(naive_rms(speeds, ["qvel.rail"])) < 1e-6


def test_a_right_model_has_skill_and_one_that_the_machine_does_not_follow_has_none() -> None:
    found, evaluator = evaluated(WINDOWS)
    assert unskilled(found, evaluator) == ()
    # The machine coasts, whatever is commanded.
    time = WINDOWS.step * torch.arange(WINDOWS.rows, dtype=torch.float64)[None, :, None]
    speed = torch.linspace(0.5, 1.5, WINDOWS.count, dtype=torch.float64)[:, None, None]
    start = torch.cat([torch.zeros_like(speed[:, :, 0]), speed[:, :, 0]], 1)
    found, evaluator = evaluated(replace(WINDOWS, value=speed * (time + WINDOWS.step), start=start))
    assert unskilled(found, evaluator) == ("qpos.rail",)
    assert not gains_with_skill(found, found, evaluator)
