"""What ``refine`` wrote as worlds to train in: all models, what is known of them, and how long an action lasts."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.problems import criticise, load_problem, load_refined
from onlinebayes.problems.control_period import control_period
from onlinebayes.report import write_report
from onlinebayes.runs import BadInput
from tests.problems.conftest import PROBLEM, table


def held_for(folder: Path, rows: int) -> Path:
    """The carriage's problem, each command held for some rows of 10 ms."""
    lines = [line.split(",") for line in table().splitlines()]
    for k in range(1, len(lines)):
        lines[k][2] = lines[k - (k - 1) % 201 % rows][2]
    (folder / "carriage.csv").write_text("\n".join(map(",".join, lines)) + "\n")
    return folder / "carriage.toml"


@pytest.mark.parametrize(("rows", "period"), [(1, 0.01), (3, 0.03), (50, 0.01)])
def test_an_action_lasts_as_long_as_the_log_held_a_command(folder: Path, rows: int, period: float) -> None:
    assert control_period(load_problem(held_for(folder, rows)).measurement) == pytest.approx(period)


def refined(folder: Path) -> Path:
    """A folder as ``refine`` leaves it."""
    out = folder / "out"
    (folder / "carriage.toml").write_text(f'{PROBLEM}\n[effects]\ncandidates = ["constant_load"]\n')
    result = criticise("refine", load_problem(folder / "carriage.toml"))
    write_report(result, out, problem=folder / "carriage.toml")
    return out


def test_worlds_are_integrated_as_the_fit_was_and_drawn_from_what_it_says(folder: Path) -> None:
    found = load_refined(refined(folder))
    report = json.loads((folder / "out" / "report.json").read_text())
    worlds = found.worlds(3)
    assert (worlds.worlds, worlds.dt) == (3, pytest.approx(0.01))
    assert worlds.timestep == report["integration"]["timestep"]
    assert worlds.parameters.names == found.problem.simulator.parameters.names
    draws = found.belief.sample((4000,), torch.Generator().manual_seed(0)).double()
    for k, name in enumerate(worlds.parameters):
        told = report["parameters"][name]
        assert float(draws[:, k].mean()) == pytest.approx(told["mean"], abs=max(0.3 * told["sd"], 1e-3))
    state = worlds.reset(draws[:3])
    after = worlds.step(TensorDict({"command": torch.ones(3, 1, dtype=torch.float64)}, batch_size=[3]))
    assert bool((after["qvel"] != state["qvel"]).all())
    assert found.worlds(1, control_period=0.05).dt == 0.05
    with pytest.raises(BadInput, match="whole number of timesteps"):
        found.worlds(1, control_period=0.0123)


def test_models_that_are_left_open_stand_in_one_simulator(folder: Path) -> None:
    out = refined(folder)
    text = (out / "refined.toml").read_text()
    assert "add = []" in text
    (out / "refined-2.toml").write_text(text.replace("add = []", 'add = ["quadratic_drag@carriage"]'))
    assert load_refined(out).worlds(1).parameters.names[-1] == "quadratic_drag@carriage.drag"
    with pytest.raises(BadInput, match="has 1 models, beside 2"):  # report.json is of the first alone
        _ = load_refined(out).belief
