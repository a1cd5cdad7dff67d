"""Refined models as objects: values that differ between runs, known ones among them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from onlinebayes.problems import load_refined
from tests.problems.conftest import PROBLEM


def refined(folder: Path, text: str, values: dict[str, float]) -> Path:
    """The folder as refine leaves it: the problem, and a report with these values."""
    (folder / "refined.toml").write_text(text)
    report = {"parameters": {name: {"mean": value, "sd": 0.1} for name, value in values.items()}}
    (folder / "report.json").write_text(json.dumps(report))
    return folder


def test_a_value_that_runs_know_and_nobody_fits_is_their_mean(folder: Path) -> None:
    text = PROBLEM + '[runs.first]\n"actuator.motor.gear[0]" = 3.0\n'
    found = load_refined(refined(folder, text, {"body.carriage.mass": 4.0, "joint.carriage.damping": 1.0}))
    assert found.problem.simulator.parameters.names[-1] == "actuator.motor.gear[0]"
    assert found.theta.tolist() == [4.0, 1.0, 2.5]  # 3 in one run, the model's own 2 in the other
    assert found.sd[-1] == 0


@pytest.mark.parametrize("runs", [("first", "second"), ("f*", "[s]*")])
def test_own_values_of_an_address_with_an_index_are_found(folder: Path, runs: tuple[str, str]) -> None:
    own = '"actuator.motor.gear[0]" = { low = 1.0, high = 9.0, scope = "per_run" }\n'
    values = {f"actuator.motor.gear[0][run {run}]": value for run, value in zip(runs, (2.0, 3.0), strict=True)}
    found = load_refined(
        refined(folder, PROBLEM + own, {"body.carriage.mass": 4.0, "joint.carriage.damping": 1.0, **values})
    )
    torch.testing.assert_close(found.theta, torch.tensor([4.0, 1.0, 2.5]).double())
