"""The hopper's study: its table from outcomes made up here, and a small sample."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.runs import seed_everything
from onlinebayes.trainers import OnlineState
from recipes import hopper
from recipes.hopper import Settings
from recipes.studies import hopper as study


def test_a_window_keeps_trajectories_that_last() -> None:
    mask = torch.ones(3, 60, dtype=torch.bool)
    mask[1, 40:] = False
    data = TensorDict({"mask": mask, "step": torch.arange(60).expand(3, -1)}, batch_size=[3, 60])
    assert study.window(data, 0).shape == (2, 50)
    assert study.window(data, 10)["step"][0, 0] == 10
    assert study.window(data[:, :20], 0).shape == (2 + 1, 20)


def test_the_table_holds_what_reaches_its_goal() -> None:
    parts = {"density": 4.5, "median": 4.6, "TARP": 0.06, "kept": 290, "most": 5.0}
    found, both = {}, dict.fromkeys(study.ENGINES, parts)
    near = {engine: {**parts, "density": 4.8} for engine in study.ENGINES}
    for low in study.LOWS:
        found["friction", low, 1] = {"prior": 1.6, "starting": near, "running": both}
        found["policy", low, 1, "prior"] = {"drake": 900.0, "mujoco": 950.0, "density": 1.6, "frames": 10}
        found["policy", low, 1, "online"] = {"drake": 2500.0, "mujoco": 2600.0, "density": 3.0, "frames": 10}
    table = study.tabled(found, study.Study(seeds=(1,)))
    rows = {row.name: row.holds for row in table.rows}
    assert rows["prior U[0.3, 0.5], online: return in Drake"]
    assert rows["prior U[0.3, 0.5]: online above prior, in Drake"]
    assert rows["prior U[0.1, 0.5], running, measured in Drake: log density of the truth"] is None
    assert rows["prior U[0.1, 0.5], running, measured in MuJoCo: below the exact one"] is False
    assert rows["prior U[0.1, 0.5], starting, measured in MuJoCo: below the exact one"]
    assert rows["prior U[0.1, 0.5], running, measured in MuJoCo: TARP error"] is False


@pytest.mark.slow
def test_a_sample_of_the_friction(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pydrake", reason="needs the extra robotics")
    for name, value in {"SIMULATIONS": 300, "THETAS": 30, "KNOWN": 4, "RUN_UP": 0, "STEPS": 8, "EPOCHS": 4}.items():
        monkeypatch.setattr(study, name, value)
    monkeypatch.setattr(study, "WINDOWS", {"starting": 0})

    def untrained(out: str, low: float, seed: int, kind: str):
        seed_everything(seed)
        made = hopper.build(Settings(seed=seed, low=low, short=True))
        return made, OnlineState.begin(made.problem.prior)

    monkeypatch.setattr(study, "trained", untrained)
    found = study.told("unused", 0.1, 1)
    assert found["prior"] == pytest.approx(0.9163, abs=1e-3)
    for real in study.ENGINES:
        assert found["starting"][real]["kept"] > 20
        # Eight steps of an untrained policy tell next to nothing: the prior's density, give or take .4 nats.
        assert abs(found["starting"][real]["density"] - found["prior"]) < 0.4
