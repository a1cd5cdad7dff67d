"""A link that is heavier than its file says: denser throughout, or by a weight at its centre, as the log has it."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism import refine
from onlinebayes.criticism.hypotheses.explanation import start_search
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator

NOISE, ROW = 3e-4, 0.01  # [rad], [s]
ARM = """<mujoco><option timestep="0.01" integrator="RK4"/><worldbody>
<body name="upper"><joint name="shoulder" axis="0 1 0" damping=".1"/>
<geom type="capsule" size=".03" fromto="0 0 0 0 0 -.4" mass="1"/>
<body name="fore" pos="0 0 -.4"><joint name="elbow" axis="0 1 0" damping=".05"/>
<geom type="capsule" size=".02" fromto="0 0 0 0 0 -.3" mass=".5"/></body></body></worldbody>
<actuator><motor name="m1" joint="shoulder"/><motor name="m2" joint="elbow"/></actuator></mujoco>"""
FREE = ParameterSpace({"body.fore.mass": Parameter(0.1, 2.0, "kg"), "joint.elbow.damping": Parameter(0.0, 0.5)})
TRUTH = torch.tensor([0.9, 0.08], dtype=torch.float64)


def recorded(machine: MujocoSimulator) -> Measurement:
    """Eight runs of three seconds of that machine."""
    rng, rows, R = np.random.default_rng(0), 301, 8
    time = ROW * torch.arange(rows, dtype=torch.float64)
    rate, phase = (torch.from_numpy(rng.uniform(*ends, (R, 1, 2, 3))) for ends in ((0.3, 1.5), (0, 6)))
    size = torch.tensor([1.2, 0.3], dtype=torch.float64)
    torque = size * torch.sin(6.2832 * rate * time[:, None, None] + phase).sum(-1)
    zero = torch.zeros(R, 2, dtype=torch.float64)
    start = TensorDict({"qpos": zero, "qvel": zero}, batch_size=(R,))
    inputs = TensorDict({"command": torque[:, :-1]}, batch_size=(R, rows - 1))
    path = machine.rollout(TRUTH.expand(R, -1), start, inputs, time[1:])["qpos"]
    angle = torch.cat([zero[:, None], path], 1) + NOISE * torch.from_numpy(rng.normal(size=(R, rows, 2)))
    runs = {
        f"run{r}": {
            "time": time,
            **{f"ctrl.m{j + 1}": torque[r, :, j] for j in (0, 1)},
            **{f"qpos.{joint}": angle[r, :, j] for j, joint in enumerate(("shoulder", "elbow"))},
        }
        for r in range(R)
    }
    return Measurement.from_runs(
        runs, signals=[Signal(f"qpos.{joint}", "rad", sd=NOISE) for joint in ("shoulder", "elbow")]
    )


def model() -> MujocoSimulator:
    return MujocoSimulator(ARM, FREE, threads=1)


@pytest.mark.slow
@pytest.mark.parametrize("denser", [True, False])
def test_the_log_decides_whether_moments_follow_the_mass(denser: bool) -> None:
    machine = model().with_scaled_moments() if denser else model()
    search = start_search(model(), recorded(machine))
    assert search.evaluator.discretisation.values.scaled_moments == denser
    assert float(search.base.left_out[0].rms.max()) < 1.1
    assert search.base.fitted.theta.tolist() == pytest.approx(TRUTH.tolist(), rel=0.01)


@pytest.mark.long
def test_a_denser_link_is_no_missing_effect() -> None:
    """With the model's own moments the centres of both links and a payload were accepted for it."""
    result = refine(model(), recorded(model().with_scaled_moments()), holdout=["run6", "run7"])
    assert (result.verdict, result.accepted) == ("adequate", ())
    assert any("moments of inertia" in note for note in result.notes)
    assert not any("as if a simulator" in note for note in result.notes)
    low, high = result.parameters["body.fore.mass"].q05, result.parameters["body.fore.mass"].q95
    assert low - 0.01 < 0.9 < high + 0.01
