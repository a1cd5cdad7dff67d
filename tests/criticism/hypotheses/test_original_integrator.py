"""Logs that MuJoCo itself wrote, by Euler's method and with its own soft friction: the model is judged as it is run."""

from __future__ import annotations

from functools import cache

import mujoco
import numpy as np
import pytest
import torch

from onlinebayes.criticism import refine
from onlinebayes.criticism.hypotheses.explanation import start_search
from onlinebayes.criticism.hypotheses.search import Search
from onlinebayes.identification.replaying.integration import Integration
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import DryFriction
from onlinebayes.simulators.mujoco import MujocoSimulator

TRIED = ["dry_friction", "joint_stiffness", "constant_load", "actuator_delay", "actuator_gain"]
NOISE, ROW = 2e-4, 0.01  # [rad], [s]
ARM = """<mujoco><worldbody><body name="arm"><joint name="arm" axis="0 1 0" damping=".1"{more}/>
<geom type="capsule" size=".03" fromto="0 0 0 0 0 -.4" mass="1"/></body></worldbody>
<actuator><motor name="motor" joint="arm"/></actuator></mujoco>"""
SOFT = ' frictionloss=".03"'
FREE = ParameterSpace(
    {"body.arm.mass": Parameter(0.3, 3.0, "kg"), "joint.arm.damping": Parameter(0.0, 1.0, "N m s/rad")}
)


def simulator() -> MujocoSimulator:
    return MujocoSimulator(ARM.format(more=""), FREE, threads=1)


@cache
def recorded(more: str = "", timestep: float = 0.002) -> Measurement:
    """Nine runs of three seconds of MuJoCo's own integration of the arm."""
    model, rng, runs = mujoco.MjModel.from_xml_string(ARM.format(more=more)), np.random.default_rng(0), {}
    model.opt.timestep, every = timestep, round(ROW / timestep)
    time = ROW * np.arange(301)
    for number in range(9):
        data = mujoco.MjData(model)
        phase, rate = rng.uniform(0, 6, (3, 1)), rng.uniform(0.3, 1.5, (3, 1))
        torque, angle = 0.5 * np.sin(2 * np.pi * rate * time + phase).sum(0), np.empty(301)
        for row in range(301):
            data.ctrl[0], angle[row] = torque[row], data.qpos[0] + rng.normal(0, NOISE)
            mujoco.mj_step(model, data, every)
        columns = {"time": time, "ctrl.motor": torque, "qpos.arm": angle}
        runs[f"run{number}"] = {name: torch.from_numpy(values) for name, values in columns.items()}
    return Measurement.from_runs(runs, signals=[Signal("qpos.arm", "rad", sd=NOISE)])


def left(search: Search) -> float:
    """RMS of what the base model leaves out of sample [floors]."""
    return float(search.base.left_out[0].rms.max())


@pytest.mark.slow
def test_the_step_that_wrote_the_log_is_kept() -> None:
    """A finer one errs by more than four floors."""
    search = start_search(simulator(), recorded())
    assert search.evaluator.original_integrator
    assert search.evaluator.discretisation.values.method != "runge_kutta"
    assert left(search) < 1.1
    assert search.base.fitted.theta.tolist() == pytest.approx([1.0, 0.1], rel=2e-3)


@pytest.mark.slow
def test_it_is_left_where_noise_is_all_that_a_finer_one_leaves() -> None:
    smooth = ARM.replace("<worldbody>", '<option integrator="RK4"/><worldbody>', 1)
    search = start_search(MujocoSimulator(smooth.format(more=""), FREE, threads=1), recorded(timestep=0.0001))
    assert not search.evaluator.original_integrator
    assert left(search) < 1.1


TURNING = """<mujoco><option timestep=".005"/><worldbody><body><joint name="shoulder" axis="0 1 0" damping=".05"/>
<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="1"/>
<body pos="0 0 -.3"><joint name="elbow" axis="0 1 0" damping=".02"/>
<geom type="capsule" fromto="0 0 0 0 0 -.25" size=".02" mass=".5"/></body></body></worldbody>
<actuator><motor name="m1" joint="shoulder"/><motor name="m2" joint="elbow"/></actuator></mujoco>"""


def turning(runs: int = 4, seconds: float = 2.0, timestep: float = 0.005) -> Measurement:
    """Two links that turn over, integrated by Euler's method at the file's own 5 ms."""
    model, rng, tables = mujoco.MjModel.from_xml_string(TURNING), np.random.default_rng(1), {}
    model.opt.timestep, every = timestep, round(ROW / timestep)
    time = ROW * np.arange(round(seconds / ROW) + 1)
    for number in range(runs):
        data = mujoco.MjData(model)
        phase, rate = rng.uniform(0, 6, (2, 3, 1)), rng.uniform(0.3, 2.0, (2, 3, 1))
        torque = (np.array([3.0, 1.0])[:, None, None] * np.sin(2 * np.pi * rate * time + phase)).sum(1)
        angle = np.empty((len(time), 2))
        for row in range(len(time)):
            data.ctrl[:], angle[row] = torque[:, row], data.qpos + rng.normal(0, 1e-4, 2)
            mujoco.mj_step(model, data, every)
        columns = {"time": time, "ctrl.m1": torque[0], "ctrl.m2": torque[1]}
        tables[f"run{number}"] = {**columns, "qpos.shoulder": angle[:, 0], "qpos.elbow": angle[:, 1]}
    signals = [Signal(f"qpos.{joint}", "rad", sd=1e-4) for joint in ("shoulder", "elbow")]
    return Measurement.from_runs(tables, signals=signals)


@pytest.mark.long
def test_the_own_step_is_fitted_where_theta_of_another_tells_nothing() -> None:
    dampings = ParameterSpace({f"joint.{joint}.damping": Parameter(0.0, 1.0) for joint in ("shoulder", "elbow")})
    search = start_search(MujocoSimulator(TURNING, dampings, threads=1), turning())
    assert search.evaluator.discretisation.values.timestep == 0.005
    assert left(search) < 1.1
    assert search.base.fitted.theta.tolist() == pytest.approx([0.05, 0.02], rel=1e-3)


@pytest.mark.long
def test_its_friction_is_kept_soft() -> None:
    """Friction that sticks leaves five floors."""
    rubbing = simulator().with_effect(DryFriction("arm", Parameter(0.0, 0.5, "N m")))
    search = start_search(rubbing, recorded(SOFT))
    assert search.evaluator.discretisation.values == Integration(0.002, soft_friction=True)
    assert left(search) < 1.1
    assert search.base.fitted.theta.tolist() == pytest.approx([1.0, 0.1, 0.03], rel=2e-3)


@pytest.mark.long
@pytest.mark.parametrize(("more", "effects"), [("", ()), (SOFT, ("dry_friction@arm",))])
def test_its_logs_are_explained(more: str, effects: tuple[str, ...]) -> None:
    """To the noise: friction that sticks would leave two and a half floors."""
    result = refine(simulator(), recorded(more), holdout=["run7", "run8"], candidates=TRIED)
    assert result.accepted == effects
    assert result.verdict == ("missing_effect" if effects else "adequate")
    assert result.remainder.rms_over_floor["qpos.arm"] < 1.2
    assert any("soft friction" in note for note in result.notes) == bool(effects)
    for name, true in (("body.arm.mass", 1.0), ("joint.arm.damping", 0.1), ("dry_friction@arm.frictionloss", 0.03)):
        if name in result.parameters:
            assert result.parameters[name].mean == pytest.approx(true, rel=0.005)
