"""Values of masses, dampings and gears rest on moments of inertia, where nothing else says how large they are."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from onlinebayes.identification.data.windows import Windows, make_windows
from onlinebayes.identification.fitting.fit import Fit, weighed_by_noise
from onlinebayes.identification.fitting.gauss_newton import fit
from onlinebayes.identification.fitting.identifiability import flat_directions, rests_on_moments
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator

NOISE, ROW = 3e-4, 0.01  # [rad], [s]
MASS, DAMPING, GEAR = "body.link.mass", "joint.hinge.damping", "actuator.motor.gear[0]"
BOUNDS = {MASS: Parameter(0.167, 1.5, "kg"), DAMPING: Parameter(0.0, 0.09), GEAR: Parameter(0.333, 3.0)}
LINK = """<mujoco><option timestep="0.01" integrator="RK4"/><worldbody>
<body name="link"><joint name="hinge" axis="{axis}" damping=".03"/>
<geom type="capsule" size=".02" fromto="0 0 0 {end}" mass="{mass}" contype="0" conaffinity="0"/></body></worldbody>
<actuator><motor name="motor" joint="hinge"/></actuator></mujoco>"""
HANGING = {"axis": "0 1 0", "end": "0 0 -.4"}
TURNTABLE = {"axis": "0 0 1", "end": ".4 0 0"}


def recorded(where: dict[str, str], mass: float) -> Measurement:
    """Four runs of three seconds of a link of that mass, moments and all."""
    machine = MujocoSimulator(LINK.format(**where, mass=mass), ParameterSpace(), threads=1)
    rng, rows, R = np.random.default_rng(0), 301, 4
    time = ROW * torch.arange(rows, dtype=torch.float64)
    rate, phase = (torch.from_numpy(rng.uniform(*ends, (R, 1, 3))) for ends in ((0.3, 1.5), (0, 6)))
    torque = 0.2 * torch.sin(6.2832 * rate * time[:, None] + phase).sum(-1)
    zero = torch.zeros(R, 1, dtype=torch.float64)
    start = TensorDict({"qpos": zero, "qvel": zero}, batch_size=(R,))
    inputs = TensorDict({"command": torque[:, :-1, None]}, batch_size=(R, rows - 1))
    path = machine.rollout(torch.zeros(R, 0).double(), start, inputs, time[1:])["qpos"][..., 0]
    angle = torch.cat([zero, path], 1) + NOISE * torch.from_numpy(rng.normal(size=(R, rows)))
    runs = {f"run{r}": {"time": time, "ctrl.motor": torque[r], "qpos.hinge": angle[r]} for r in range(R)}
    return Measurement.from_runs(runs, signals=[Signal("qpos.hinge", "rad", sd=NOISE)])


def fitted(where: dict[str, str], *free: str) -> tuple[Fit, Windows]:
    """A model of a link of half a kilogram, fitted to one of .8 kg."""
    space = ParameterSpace({name: BOUNDS[name] for name in free})
    model = MujocoSimulator(LINK.format(**where, mass=0.5), space, threads=1)
    windows = make_windows(model, recorded(where, 0.8), 1.0)
    return weighed_by_noise(fit(model, windows, model.nominal), windows), windows


def test_with_a_gear_free_only_ratios_are_known() -> None:
    """The fit is perfect and wrong: the model's moment of inertia, which is too small, tells mass from gear."""
    found, windows = fitted(HANGING, MASS, DAMPING, GEAR)
    assert found.theta.tolist() == pytest.approx([0.5, 0.03 / 1.6, 1 / 1.6], rel=0.01)
    (flat,) = flat_directions(found, windows.bin_step, windows.bin_step)
    assert "only ratios of" in flat.description
    assert all(name in flat.description for name in (MASS, DAMPING, GEAR))
    # Along that direction all three move by one factor.
    shares = [flat.direction[name] * (BOUNDS[name].high - BOUNDS[name].low) for name in (MASS, DAMPING, GEAR)]
    factors = torch.tensor(shares).double() / found.theta
    assert float(factors.std() / factors.mean().abs()) < 0.02


def test_a_known_gear_makes_the_mass_known() -> None:
    """Gravity weighs it, and the data tell the moment of inertia by themselves."""
    found, windows = fitted(HANGING, MASS, DAMPING)
    assert flat_directions(found, windows.bin_step, windows.bin_step) == ()
    covariance = rests_on_moments(found, windows.bin_step, windows.bin_step)
    assert float(covariance[0, 0].sqrt()) < 0.05 * 0.8


def test_about_a_vertical_axis_a_mass_is_as_uncertain_as_its_moment() -> None:
    """The model's own moment is a quarter of what the hinge turns; it is known to a factor that the mass allows."""
    found, windows = fitted(TURNTABLE, MASS, DAMPING)
    covariance = rests_on_moments(found, windows.bin_step, windows.bin_step)
    assert 0.1 < float(covariance[0, 0].sqrt()) < 0.5
    assert float(covariance[1, 1].sqrt()) < 0.02 * 0.03
