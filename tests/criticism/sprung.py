"""A sprung slide that was hardly moved: a constant load and a weak spring, at rest far away, look alike on it."""

from __future__ import annotations

import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import ConstantLoad, Effect, JointStiffness
from onlinebayes.simulators.mujoco import MujocoSimulator

MODEL = """
<mujoco><option timestep="0.02" integrator="RK4" gravity="0 0 0"/><worldbody><body name="cart">
  <joint name="rail" type="slide" axis="1 0 0" damping="8" stiffness="60"/>
  <inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>
</body></worldbody><actuator><motor name="motor" joint="rail"/></actuator></mujoco>"""

FREE = ParameterSpace(
    {"body.cart.mass": Parameter(0.5, 8.0, "kg"), "joint.rail.damping": Parameter(0.0, 30.0, "N s/m")}
)
TRUTH = (2.3, 9.0)
NOISE = 5e-5
LOAD = ConstantLoad("rail", Parameter(-1.2, 1.2, "N"))
SPRING = JointStiffness("rail", Parameter(0.0, 2.0, "N/m"), Parameter(-1.5, 1.5, "m"))
SIZES: dict[Effect, tuple[float, ...]] = {LOAD: (0.3,), SPRING: (0.3, 1.0)}
REST = 0.005
HELD_OUT = ("run7", "run8")


def model(text: str = MODEL, parameters: ParameterSpace = FREE) -> MujocoSimulator:
    return MujocoSimulator(text, parameters, threads=1)


def record(
    simulator: MujocoSimulator, theta: tuple[float, ...], time: Tensor, command: Tensor, start: float, seed: int
) -> dict[str, object]:
    """One run from rest, integrated four times finer than the model, read by a noisy sensor."""
    fine = simulator.with_timestep(simulator.timestep / 4)
    zero = torch.zeros(1, 1, dtype=torch.float64)
    path = fine.rollout(
        torch.tensor([theta], dtype=torch.float64),
        TensorDict({"qpos": zero + start, "qvel": zero}, batch_size=(1,)),
        TensorDict({"command": command[None, :-1]}, batch_size=(1, len(command) - 1)),
        time[1:],
    )
    q = torch.cat([zero[0] + start, path["qpos"][0, :, 0]])
    q = q + NOISE * torch.randn(q.shape, generator=torch.Generator().manual_seed(seed), dtype=q.dtype)
    return {"time": time.numpy(), "ctrl.motor": command[:, 0].numpy(), "qpos.rail": q.numpy()}


def small_runs(simulator: MujocoSimulator, theta: tuple[float, ...], size: float = 0.04) -> dict[str, dict]:
    """Nine runs of two seconds about where the slide hangs."""
    time = torch.arange(101, dtype=torch.float64) * 0.02
    runs = {}
    for r in range(9):
        u = size * (torch.sin((3.1 + r) * time) + torch.sin(6.7 * time + r) + torch.sin(1.1 * time))
        runs[f"run{r}"] = record(simulator, theta, time, u[:, None], REST, r)
    return runs


def measurement(runs: dict[str, dict]) -> Measurement:
    return Measurement.from_runs(runs, signals=[Signal("qpos.rail", "m", sd=NOISE)], commands=["motor"])
