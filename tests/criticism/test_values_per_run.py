"""A parameter that differs between runs is found, sized in each of them, and is no effect."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism import Scope, refine
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import ConstantLoad
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import NOISE, SLIDE, commands, measure

MASSES = (2.0, 2.2, 2.4, 2.6, 2.8, 3.0, 2.1, 2.9, 2.5)
FREE = ParameterSpace({"body.cart.mass": Parameter(0.5, 8.0, "kg")})


def loaded_differently() -> tuple[MujocoSimulator, Measurement]:
    """The slide with another load in every run."""
    model, runs, rows = MujocoSimulator(SLIDE, FREE, threads=1), len(MASSES), 301
    command, zero = commands(runs, rows, 0.01, 0), torch.zeros(runs, 1, dtype=torch.float64)
    path = model.rollout(
        torch.tensor(MASSES, dtype=torch.float64)[:, None],
        TensorDict({"qpos": zero, "qvel": zero}, batch_size=(runs,)),
        TensorDict({"command": command[:, :-1]}, batch_size=(runs, rows - 1)),
        torch.arange(1, rows, dtype=torch.float64) * 0.01,
    )
    shown = torch.cat([zero, path["qpos"][..., 0]], 1)
    shown += NOISE * torch.randn(shown.shape, generator=torch.Generator().manual_seed(1), dtype=shown.dtype)
    time = (torch.arange(rows, dtype=torch.float64) * 0.01).numpy()
    table = {
        f"run{r}": {"time": time, "ctrl.motor": command[r, :, 0].numpy(), "qpos.rail": shown[r].numpy()}
        for r in range(runs)
    }
    return model, Measurement.from_runs(table, [Signal("qpos.rail", "m", sd=NOISE)], commands=["motor"])


@pytest.mark.slow
def test_a_load_that_differs_between_runs_is_sized_in_each() -> None:
    model, measured = loaded_differently()
    found = refine(model, measured, holdout=["run7", "run8"])
    (change,) = found.changes
    assert (found.verdict, found.accepted, change.parameter) == ("unexplained", (), "body.cart.mass")
    for run, mass in enumerate(MASSES[:7]):
        value = change.values[f"run{run}"]
        assert abs(value.mean - mass) < max(4 * value.sd, 0.01)  # 7 values: false failures are below 1 in 2000
    assert found.remainder.status == "noise"
    assert found.heldout_error.after["qpos.rail"] < 0.1 * found.heldout_error.before["qpos.rail"]
    assert change.lines.endswith('"body.cart.mass" = { low = 0.5, high = 8, scope = "per_run" }')


@pytest.mark.slow
def test_a_force_that_groups_of_runs_share_is_sized_in_each_group() -> None:
    """Three specimens, three runs of each; the last run of each is held out."""
    model, loads = MujocoSimulator(SLIDE, FREE, threads=1), (-0.4, 0.1, 0.6)
    load = ConstantLoad("rail", Parameter(-5.0, 5.0, "N"))
    parts = [measure({load: (size,)}, runs=3, seed=k, truth=(2.4, 1.0)) for k, size in enumerate(loads)]
    names = [f"{'abc'[k]}-{r}" for k in range(3) for r in range(3)]
    data = torch.cat([part.data for part in parts])
    measured = replace(parts[0], data=data, runs=tuple(names))
    scope = Scope(per_run=("constant_load@rail",), groups=("a-*", "b-*", "c-*"))
    found = refine(model, measured, holdout=["a-2", "b-2", "c-2"], candidates=["constant_load"], scope=scope)
    assert found.accepted == ("constant_load@rail",)
    for group, size in zip("abc", loads, strict=True):
        (value,) = [v for name, v in found.parameters.items() if f"[run {group}-*]" in name]
        assert abs(value.mean - size) < 0.03
    assert found.remainder.status == "noise"
