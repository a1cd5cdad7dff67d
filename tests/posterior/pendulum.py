"""Logs of a driven pendulum whose truth is known, read by a noisy sensor."""

from __future__ import annotations

import math

import torch
from tensordict import TensorDict

from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator

PENDULUM = """
<mujoco model="pendulum"><option timestep="0.02" integrator="RK4"/><worldbody><body name="bob">
  <joint name="hinge" axis="0 1 0" damping="0.05"/>
  <inertial pos="0 0 -0.5" mass="1" diaginertia="0.01 0.01 0.01"/>
</body></worldbody><actuator><motor name="motor" joint="hinge"/></actuator></mujoco>"""

FREE = ParameterSpace(
    {"body.bob.mass": Parameter(0.5, 2.0, "kg"), "joint.hinge.damping": Parameter(0.0, 0.5, "N m s/rad")}
)
STEP = 0.02
POINT_MASS = PENDULUM.replace("0.01 0.01 0.01", "1e-6 1e-6 1e-6")


def model(free: ParameterSpace = FREE, xml: str = PENDULUM) -> MujocoSimulator:
    return MujocoSimulator(xml, free, threads=1)


def log(
    truth: torch.Tensor,
    seed: int,
    *,
    free: ParameterSpace = FREE,
    xml: str = PENDULUM,
    runs: int = 2,
    seconds: float = 10.0,
    noise: float = 0.01,
    memory: float = 0.0,
    seen_sd: float | None = None,
) -> Measurement:
    """Runs from rest under three tones each, the last one to be held out.

    Args:
        truth: of the parameters [SI].
        seed: of the tones and the noise.
        free, xml: the parameters and the model.
        runs, seconds: how many runs, and how long.
        noise: sd of the sensor [rad].
        memory: correlation of the noise from one row to the next.
        seen_sd: what the table says of the noise; estimated when None.
    """
    draw = torch.Generator().manual_seed(seed)
    time = STEP * torch.arange(round(seconds / STEP) + 1, dtype=torch.float64)
    frequency = 0.2 + 1.3 * torch.rand(runs, 3, 1, generator=draw, dtype=torch.float64)
    phase = 6.3 * torch.rand(runs, 3, 1, generator=draw, dtype=torch.float64)
    command = 1.2 * torch.sin(2 * math.pi * frequency * time + phase).sum(1)
    rest = torch.zeros(runs, 1, dtype=torch.float64)
    path = model(free, xml).rollout(
        truth.expand(runs, -1),
        TensorDict({"qpos": rest, "qvel": rest}, [runs]),
        TensorDict({"command": command[:, :-1, None]}, [runs, len(time) - 1]),
        time[1:],
    )
    angle = torch.cat([rest, path["qpos"][..., 0]], 1)
    error = torch.randn(angle.shape, generator=draw, dtype=torch.float64)
    for k in range(1, angle.shape[1] if memory else 0):
        error[:, k] = memory * error[:, k - 1] + math.sqrt(1 - memory**2) * error[:, k]
    angle = angle + noise * error
    table = {
        f"run{r}": {"time": time.numpy(), "ctrl.motor": command[r].numpy(), "qpos.hinge": angle[r].numpy()}
        for r in range(runs)
    }
    return Measurement.from_runs(table, signals=[Signal("qpos.hinge", "rad", sd=seen_sd)], commands=["motor"])
