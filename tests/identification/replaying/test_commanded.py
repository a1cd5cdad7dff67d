"""Activations at the windows' starts: what the run's commands before them give, whatever the window is."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import torch

from onlinebayes.criticism.experiment.inputs import Inputs
from onlinebayes.criticism.experiment.play import FixedModel, play
from onlinebayes.identification.data.windows import MEMORY, Windows, make_windows
from onlinebayes.identification.replaying.commanded import commanded
from onlinebayes.identification.replaying.replay import history_rows, replay, rollout
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import ActuatorDelay
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import FREE, SLIDE, TRUTH, commands, measure, model

STEP, ROWS, RUNS, HORIZON = 0.01, 401, 2, 1.0
THETA = torch.tensor([TRUTH]).double()
KINDS = {
    "filterexact": '<general name="motor" joint="rail" dyntype="filterexact" dynprm="0.05"/>',
    "filter": '<general name="motor" joint="rail" dyntype="filter" dynprm="0.05"/>',
    "integrator": '<intvelocity name="motor" joint="rail" kp="60" kv="6" actrange="-1 1"/>',
}


def rig(kind: str) -> MujocoSimulator:
    return MujocoSimulator(SLIDE.replace('<motor name="motor" joint="rail"/>', KINDS[kind]), FREE, threads=1)


def whole_runs(simulator: MujocoSimulator, start: float | None) -> tuple[Measurement, np.ndarray]:
    """Plain MuJoCo over whole runs, and its activation at every row; without a start it was settled at the first."""
    plain, table, act = mujoco.MjModel.from_xml_string(simulator.export_xml(THETA[0])), {}, np.zeros((RUNS, ROWS))
    command = commands(RUNS, ROWS, STEP, 0)[..., 0].numpy()
    for r in range(RUNS):
        data, path = mujoco.MjData(plain), np.zeros((ROWS, 2))
        data.act[0] = command[r, 0] if start is None else start
        for k in range(ROWS):
            act[r, k], path[k] = data.act[0], (data.qpos[0], data.qvel[0])
            data.ctrl[0] = command[r, k]
            mujoco.mj_step(plain, data)
        columns = {"ctrl.motor": command[r], "qpos.rail": path[:, 0], "qvel.rail": path[:, 1]}
        table[f"run{r}"] = {"time": STEP * np.arange(ROWS), **columns}
    return Measurement.from_runs(table, (Signal("qpos.rail", sd=1e-9), Signal("qvel.rail", sd=1e-9))), act


def windows_of(simulator: MujocoSimulator, measurement: Measurement) -> Windows:
    return make_windows(simulator, measurement, HORIZON, MEMORY * HORIZON)


def at_starts(simulator: MujocoSimulator, windows: Windows) -> torch.Tensor:
    return commanded(simulator, windows, THETA[:, None].expand(1, windows.count, -1))["act"][:, 0]


@pytest.mark.parametrize("kind", list(KINDS))
@pytest.mark.parametrize("whole", [True, False])
def test_a_window_begins_with_the_activation_that_the_whole_run_had(kind: str, whole: bool) -> None:
    simulator = rig(kind)
    measurement, act = whole_runs(simulator, 0.0 if kind == "integrator" else None)
    windows = windows_of(simulator, measurement)
    windows = windows if whole else replace(windows, run_histories=())
    found = at_starts(simulator, windows)
    np.testing.assert_allclose(found, act[windows.run, windows.first], rtol=0, atol=1e-9)
    path = rollout(simulator, windows, THETA, windows.start[None])["act"][0, :, 0, 0]
    np.testing.assert_allclose(path, act[windows.run, windows.first + 1], rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", list(KINDS))
def test_where_an_effect_is_replayed_before_a_window_activations_are_the_same(kind: str) -> None:
    simulator = rig(kind).with_effect(ActuatorDelay("motor", Parameter(0.0, 0.1, "s")))
    measurement, act = whole_runs(rig(kind), 0.0 if kind == "integrator" else None)
    windows = windows_of(simulator, measurement)
    theta = torch.cat([THETA, torch.zeros(1, 1).double()], dim=1)
    path = rollout(simulator, windows, theta, windows.start[None])["act"][0, :, 0, 0]
    np.testing.assert_allclose(path, act[windows.run, windows.first + 1], rtol=0, atol=1e-9)


def test_an_activation_that_is_known_needs_no_replay_of_what_came_before() -> None:
    simulator = rig("filterexact")
    windows = windows_of(simulator, whole_runs(simulator, None)[0])
    assert history_rows(simulator, windows) == windows.history.shape[1]
    assert history_rows(simulator, windows, {"act"}) == 0


def test_a_log_that_begins_in_mid_jump_is_replayed_from_where_the_filter_forgot_it() -> None:
    simulator = rig("filterexact")
    measurement, _ = whole_runs(simulator, -5.0)  # nothing in the log says so
    windows = windows_of(simulator, measurement)
    assert windows.first.min() == 50  # ten time constants
    true = measurement.data["signal"][windows.run, windows.first]
    signals, valid = replay(simulator, windows, THETA, true[None])
    assert bool(valid.all())
    assert float((signals[0] - windows.value)[windows.measured].abs().max()) < 1e-3


def test_short_runs_keep_a_window() -> None:
    slow = MujocoSimulator(
        SLIDE.replace('<motor name="motor" joint="rail"/>', KINDS["filter"].replace("0.05", "5.0")), FREE, threads=1
    )
    windows = make_windows(slow, measure(runs=2, seconds=1.0), HORIZON)
    assert windows.run.tolist() == [0, 1]
    assert windows.first.tolist() == [50, 50]


def test_without_activations_windows_begin_where_runs_do() -> None:
    windows = make_windows(model(), measure(runs=2), HORIZON)
    assert int(windows.first.min()) == 0


def test_a_planned_motion_begins_under_the_settled_command() -> None:
    simulator, command = rig("filterexact"), torch.full((1, 3, 1), 2.0).double()
    inputs = Inputs(("held",), STEP, command, torch.zeros(1, 1).double(), command[:, 0], torch.ones(1).double())
    path = play(FixedModel("it", simulator, THETA[0]), inputs)
    plain = play(FixedModel("it", model(), THETA[0]), inputs)
    torch.testing.assert_close(path["qvel"], plain["qvel"], rtol=1e-9, atol=0)
