"""Fits where undamped steps are refused, fits that are given up, and starts that go astray."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.identification.data.windows import Windows, make_windows
from onlinebayes.identification.fitting.gauss_newton import SETTLED, fit
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import Cogging, DryFriction, JointStiffness
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import TRUTH, measure, model

FRICTION = DryFriction("rail", Parameter(0.0, 5.0, "N"))
SPRING = JointStiffness("rail", Parameter(0.0, 20.0, "N/m"), Parameter(-3.0, 3.0, "m"))
HIDDEN = (0.8, 3.0, 0.4)


def rig() -> MujocoSimulator:
    return model().with_effect(FRICTION).with_effect(SPRING)


@pytest.fixture(scope="module")
def windows() -> Windows:
    return make_windows(rig(), measure({FRICTION: HIDDEN[:1], SPRING: HIDDEN[1:]}, runs=2), 1.0)


@pytest.mark.slow
def test_a_fit_that_creeps_above_what_is_wanted_is_given_up(windows: Windows) -> None:
    # Without friction the spring's model cannot reach the noise.
    simulator = model().with_effect(SPRING)
    begin = torch.tensor([*TRUTH, 0.5, -1.0]).double()
    patient, hasty = fit(simulator, windows, begin), fit(simulator, windows, begin, wanted=0.0)
    assert hasty.score > patient.score > 0.4  # noise alone is .35
    assert fit(simulator, windows, begin, wanted=patient.score).score < patient.score + SETTLED


ARM = """
<mujoco><option timestep="0.005" integrator="RK4"/><worldbody>
<body name="upper"><joint name="shoulder" axis="0 1 0" damping="0.2"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.03" mass="1.2"/>
<body name="lower" pos="0 0 -0.4"><joint name="elbow" axis="0 1 0" damping="0.1"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.025" mass="0.7"/></body></body></worldbody>
<actuator><motor name="m1" joint="shoulder"/><motor name="m2" joint="elbow"/></actuator></mujoco>"""
DAMPING = ParameterSpace({f"joint.{j}.damping": Parameter(0.0, 1.0) for j in ("shoulder", "elbow")})
RUBBING = DryFriction("elbow", Parameter(0.0, 2.0, "N m"))


def swings(runs: int = 8, seconds: float = 6.0) -> Measurement:
    """A double pendulum with dry friction in its elbow, driven hard enough to turn over."""
    rig = MujocoSimulator(ARM, DAMPING, worlds=runs, threads=1).with_effect(RUBBING)
    draw = torch.Generator().manual_seed(0)
    time = 0.01 * torch.arange(round(seconds / 0.01) + 1, dtype=torch.float64)
    phase = 6.28 * torch.rand(runs, 4, 1, generator=draw, dtype=torch.float64)
    shoulder = 2.5 * torch.sin(1.3 * time + phase[:, 0]) + 1.5 * torch.sin(3.1 * time + phase[:, 1])
    elbow = 1.2 * torch.sin(2.1 * time + phase[:, 2]) + 0.8 * torch.sin(4.7 * time + phase[:, 3])
    command = torch.stack([shoulder, elbow], -1)
    inputs = TensorDict({"command": command[:, :-1]}, batch_size=(runs, len(time) - 1))
    theta = torch.tensor([0.2, 0.1, 0.15], dtype=torch.float64).expand(runs, -1)
    angles = torch.nn.functional.pad(rig.rollout(theta, rig.state, inputs, time[1:])["qpos"], (0, 0, 1, 0))
    angles = angles + 1e-3 * torch.randn(angles.shape, generator=draw, dtype=angles.dtype)
    tables = {
        f"run{r}": {
            "time": time.numpy(),
            **{f"ctrl.m{k + 1}": command[r, :, k].numpy() for k in range(2)},
            **{f"qpos.{joint}": angles[r, :, k].numpy() for k, joint in enumerate(("shoulder", "elbow"))},
        }
        for r in range(runs)
    }
    signals = [Signal(f"qpos.{joint}", "rad", sd=1e-3) for joint in ("shoulder", "elbow")]
    return Measurement.from_runs(tables, signals=signals, commands=["m1", "m2"])


@pytest.mark.long
def test_friction_in_a_double_pendulum_is_fitted_although_starts_go_astray() -> None:
    """The model without friction is fitted first, then with it, from there."""
    simulator = MujocoSimulator(ARM, DAMPING, threads=1)
    windows = make_windows(simulator, swings(), 1.0, 0.1)
    base = fit(simulator, windows, simulator.nominal)
    theta = torch.cat([base.theta, torch.tensor([0.15], dtype=torch.float64)])
    found = fit(simulator.with_effect(RUBBING), windows, theta, base.lin.starts)
    assert found.theta.tolist() == pytest.approx([0.2, 0.1, 0.15], rel=0.02)
    left = found.rows.residual.square().sum(1)
    assert float(left.max() / left.sum()) < 0.2


@pytest.mark.long
def test_no_start_on_top_of_a_cog_decides_a_fit() -> None:
    """From rest on top of a cog a tenth of a millimetre a second decides to which side the slide goes."""
    cogging = Cogging("rail", Parameter(0.0, 9.0, "N"), Parameter(1.0, 100.0, "rad/m"), Parameter(-3.2, 6.3, "rad"))
    simulator = model().with_timestep(0.005).with_effect(cogging)
    windows = make_windows(simulator, measure({cogging: (4.0, 90.0, 0.0)}, runs=3, seconds=2.0, finer=2), 1.0, 0.1)
    found = fit(simulator, windows, torch.tensor([*TRUTH, 4.0, 90.0, 0.0], dtype=torch.float64))
    assert found.theta[:4].tolist() == pytest.approx([*TRUTH, 4.0, 90.0], rel=0.02)
    left = found.rows.in_noise(found.rows.residual).square().mean((1, 2)).sqrt()
    assert float(left.max()) < 3 * float(left.median())
