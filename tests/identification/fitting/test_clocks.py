"""A model that is right is right on any clock: commands denser than the sensor, and rows that jitter."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism import refine
from onlinebayes.identification.data.grid import replay_step
from onlinebayes.identification.fitting.rows import rms
from onlinebayes.identification.fitting.window_length import BaseFit
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import ConstantLoad
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.identification.grounding import ground

STEP, NOISE = 0.004, 1e-4  # of the simulator that writes the log [s], of the sensor [rad]
ROWS, EVERY, RUNS = 750, 5, 6  # of that simulator, rows a measured one, runs
ARM = """<mujoco><option timestep=".004" integrator="RK4"/><worldbody><body>
<joint name="arm" axis="0 1 0" damping=".05"/>
<geom type="capsule" size=".03" fromto="0 0 0 0 0 -.3" mass=".3"/></body></worldbody>
<actuator><motor name="motor" joint="arm"/></actuator></mujoco>"""
LOADED = ConstantLoad("arm", Parameter(-0.5, 0.5, "N m"))
FREE = ParameterSpace({"joint.arm.damping": Parameter(0.0, 1.0, "N m s/rad")})


def left(found: BaseFit) -> float:
    """RMS of what the fit leaves [floors]."""
    rows = found.fitted.rows
    return float(rms(found.windows, rows.in_noise(rows.residual)).max())


def measured(held: int, jitters: bool, load: float = 0.0) -> Measurement:
    """An arm's replay: a command for ``held`` rows, the angle at each fifth or, jittering, next to it."""
    arm, draw = MujocoSimulator(ARM, FREE, worlds=RUNS, threads=1).with_effect(LOADED), np.random.default_rng(0)
    time = STEP * torch.arange(ROWS + 1, dtype=torch.float64)
    rate, phase = torch.from_numpy(draw.uniform((0.5, 0.0), (3.0, 6.0), (RUNS, 4, 2))).unbind(-1)
    command = 0.5 * torch.sin(6.28 * rate[..., None] * time + phase[..., None]).sum(1)[..., None]
    command = command[:, ::held].repeat_interleave(held, 1)[:, : ROWS + 1]
    truth = torch.tensor([[0.05, load]] * RUNS, dtype=torch.float64)
    inputs = TensorDict({"command": command[:, :-1]}, batch_size=(RUNS, ROWS))
    path = arm.rollout(truth, arm.state, inputs, time[1:])["qpos"][..., 0]
    angle = torch.nn.functional.pad(path, (1, 0)).numpy() + NOISE * draw.normal(size=(RUNS, ROWS + 1))
    runs = {}
    for run in range(RUNS):
        shown = np.arange(0, ROWS + 1, EVERY) + (draw.integers(-1, 2, ROWS // EVERY + 1) if jitters else 0)
        shown = shown.clip(0, ROWS)
        seen = np.full(ROWS + 1, np.nan)
        seen[shown] = angle[run, shown]
        columns = {"time": time.numpy(), "ctrl.motor": command[run, :, 0].numpy(), "qpos.arm": seen}
        runs[f"run{run}"] = columns
    return Measurement.from_runs(runs, signals=[Signal("qpos.arm", "rad", sd=NOISE)])


@pytest.mark.long
@pytest.mark.parametrize(("held", "jitters"), [(5, False), (1, False), (1, True)], ids=["even", "denser", "jitters"])
def test_the_right_model_leaves_noise(held: int, jitters: bool) -> None:
    """Replayed in steps that rows do not fall on, by the average of five commands, it left 39 floors."""
    grounds = ground(MujocoSimulator(ARM, FREE, threads=1), measured(held, jitters))
    assert left(grounds) < 1.1
    assert grounds.fitted.theta.tolist() == pytest.approx([0.05], rel=0.01)


FINE = MujocoSimulator(ARM.replace('".004"', '".001"'), FREE, threads=1)


def jittering(load: float) -> Measurement:
    """The arm's replay in steps of a millisecond: a command and an angle every 20 ms, up to 4 ms early or late."""
    arm, draw, steps = FINE.with_worlds(RUNS).with_effect(LOADED), np.random.default_rng(1), 3000
    rows = 20 * np.arange(steps // 20) + draw.integers(-4, 5, (RUNS, steps // 20))
    rows[:, 0] = 0
    command = np.zeros((RUNS, steps))
    for run, at in enumerate(rows):
        command[run] = (0.5 * draw.normal(size=len(at)))[np.searchsorted(at, np.arange(steps), side="right") - 1]
    truth = torch.tensor([[0.05, load]] * RUNS, dtype=torch.float64)
    inputs = TensorDict({"command": torch.from_numpy(command)[..., None]}, batch_size=(RUNS, steps))
    time = 1e-3 * torch.arange(1, steps + 1, dtype=torch.float64)
    path = arm.rollout(truth, arm.state, inputs, time)["qpos"][..., 0]
    angle = torch.nn.functional.pad(path, (1, 0)).numpy() + NOISE * draw.normal(size=(RUNS, steps + 1))
    runs = {
        f"run{run}": {"time": 1e-3 * at, "ctrl.motor": command[run, at], "qpos.arm": angle[run, at]}
        for run, at in enumerate(rows)
    }
    return Measurement.from_runs(runs, signals=[Signal("qpos.arm", "rad", sd=NOISE)])


@pytest.mark.long
@pytest.mark.parametrize(("load", "gross"), [(0.05, True), (0.0, False)], ids=["a load is missing", "right"])
def test_a_coarse_clock_is_kept_while_its_error_does_not_matter(load: float, gross: bool) -> None:
    measurement = jittering(load)
    grounds = ground(FINE, measurement)
    assert left(grounds) > 100 if gross else left(grounds) < 1.1
    assert (grounds.windows.step > 1.01 * replay_step(measurement, FINE.timestep)) == gross


@pytest.mark.long
def test_what_is_missing_is_found_there() -> None:
    arm, log = MujocoSimulator(ARM, FREE, threads=1), measured(1, True, load=0.05)
    result = refine(arm, log, candidates=["constant_load", "dry_friction"])
    assert (result.verdict, result.accepted) == ("missing_effect", ("constant_load@arm",))
    assert result.parameters["constant_load@arm.load"].mean == pytest.approx(0.05, rel=0.02)
