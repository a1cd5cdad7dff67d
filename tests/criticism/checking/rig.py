"""An arm with a hand that swings under its motor: a machine that wears, loads and loses its zero, with known truth."""

from __future__ import annotations

from dataclasses import replace

import torch
from tensordict import TensorDict

from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator

ARM = """
<mujoco><compiler angle="radian"/><option timestep="0.01" integrator="RK4"/><worldbody><body name="arm">
  <joint name="hinge" axis="0 1 0" damping="0.05" frictionloss="0"/>
  <inertial pos="0.2 0 0" mass="1" diaginertia="0.002 0.014 0.014"/></body>
</worldbody><actuator><motor name="motor" joint="hinge"/></actuator></mujoco>"""

FREE = ParameterSpace(
    {"body.arm.mass": Parameter(0.3, 3.0, "kg"), "joint.hinge.damping": Parameter(0.0, 1.0, "N m s/rad")}
)
MASS, DAMPING, NOISE = 1.2, 0.08, 1e-3
COVARIANCE = torch.diag(torch.tensor([1e-3, 1e-3], dtype=torch.float64) ** 2)
STEP = 0.01


def model() -> MujocoSimulator:
    return MujocoSimulator(ARM, FREE, threads=1)


def record(
    runs: int,
    seed: int,
    *,
    seconds: float = 4.0,
    mass: float | list[float] = MASS,
    damping: float | list[float] = DAMPING,
    offset: float = 0.0,
    name: str = "run",
    after: tuple[float, float] | None = None,
) -> Measurement:
    """Runs under three tones of torque from hanging at rest, read by a sensor with noise.

    Args:
        runs: how many.
        seed: of torques and noise.
        seconds: of each.
        mass, damping: the truth, or that of every run.
        offset: of the sensor's zero [rad].
        name: begin of the runs' names.
        after: instant in each run from which on the damping is another, and that [s, N m s/rad].
    """
    draw = torch.Generator().manual_seed(seed)
    rows = round(seconds / STEP) + 1
    t = torch.arange(rows, dtype=torch.float64) * STEP
    frequency = 0.3 + 1.5 * torch.rand(runs, 3, 1, generator=draw, dtype=torch.float64)
    phase = 6.3 * torch.rand(runs, 3, 1, generator=draw, dtype=torch.float64)
    command = 1.2 * torch.sin(6.2832 * frequency * t + phase).sum(1)[..., None]
    truth = torch.empty(runs, 2, dtype=torch.float64)
    truth[:, 0], truth[:, 1] = torch.as_tensor(mass), torch.as_tensor(damping)
    start = torch.full((runs, 1), torch.pi / 2, dtype=torch.float64)
    cut = rows - 1 if after is None else round(after[0] / STEP)
    state = TensorDict({"qpos": start, "qvel": torch.zeros(runs, 1, dtype=torch.float64)}, batch_size=(runs,))
    path = [start]
    for first, last in ((0, cut), (cut, rows - 1)):
        if first == last:
            continue
        if first and after is not None:
            truth[:, 1] = after[1]
        inputs = TensorDict({"command": command[:, first:last]}, batch_size=(runs, last - first))
        played = model().rollout(truth, state, inputs, t[1 : last - first + 1])
        path.append(played["qpos"][..., 0])
        state = played[:, -1]
    angle = torch.cat(path, 1) + offset
    angle = angle + NOISE * torch.randn(angle.shape, generator=draw, dtype=angle.dtype)
    table = {
        f"{name}{r}": {"time": t.numpy(), "ctrl.motor": command[r, :, 0].numpy(), "qpos.hinge": angle[r].numpy()}
        for r in range(runs)
    }
    return Measurement.from_runs(table, signals=[Signal("qpos.hinge", "rad", sd=NOISE)], commands=["motor"])


def later(measurement: Measurement, name: str) -> Measurement:
    """The same runs under other names."""
    return replace(measurement, runs=tuple(f"{name}{k}" for k in range(len(measurement.runs))))
