"""A pendulum and a two-joint arm whose wiring is right, simulated at a quarter of the models' step."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from tensordict import TensorDict

from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.mujoco import MujocoSimulator

STEP = 0.01
NOISE = 1e-3


@dataclass(frozen=True)
class Rig:
    """A model, its free parameters, the truth, and how hard it is driven [N m]."""

    name: str
    xml: str
    free: ParameterSpace
    truth: tuple[float, ...]
    drive: tuple[float, ...]

    def model(self) -> MujocoSimulator:
        """What is criticised."""
        return MujocoSimulator(self.xml, self.free, threads=1)

    @property
    def commands(self) -> tuple[str, ...]:
        """Names of the actuators."""
        return self.model().commands

    @property
    def positions(self) -> tuple[str, ...]:
        """Names of the position signals."""
        return tuple(name for name in self.model().signals if name.startswith("qpos."))

    def measure(
        self,
        effects: dict[Effect, tuple[float, ...]] | None = None,
        compensated: bool = False,
        runs: int = 8,
        seconds: float = 3.0,
    ) -> Measurement:
        """Runs from rest with these effects hidden, or the weight carried."""
        truth = self.model()
        if compensated:
            truth = truth.with_gravity_compensation() or truth
        theta = list(self.truth)
        for effect, values in (effects or {}).items():
            truth, theta = truth.with_effect(effect), theta + list(values)
        truth = truth.with_timestep(truth.timestep / 4)
        rows, joints = round(seconds / STEP) + 1, len(self.positions)
        draw = torch.Generator().manual_seed(1)
        t = torch.arange(rows, dtype=torch.float64) * STEP
        frequency = 0.3 + 1.2 * torch.rand(runs, 3, len(self.drive), 1, generator=draw, dtype=torch.float64)
        phase = 6.3 * torch.rand(runs, 3, len(self.drive), 1, generator=draw, dtype=torch.float64)
        command = torch.sin(6.2832 * frequency * t + phase).sum(1).mT * torch.tensor(self.drive, dtype=torch.float64)
        zero = torch.zeros(runs, joints, dtype=torch.float64)
        path = truth.rollout(
            torch.tensor(theta, dtype=torch.float64).expand(runs, -1),
            TensorDict({"qpos": zero, "qvel": zero}, batch_size=(runs,)),
            TensorDict({"command": command[:, :-1]}, batch_size=(runs, rows - 1)),
            t[1:],
        )
        angle = torch.cat([zero[:, None], path["qpos"]], 1)
        angle = angle + NOISE * torch.randn(angle.shape, generator=draw, dtype=angle.dtype)
        table = {
            f"run{r}": {"time": t.numpy()}
            | {f"ctrl.{name}": command[r, :, u].numpy() for u, name in enumerate(self.commands)}
            | {name: angle[r, :, j].numpy() for j, name in enumerate(self.positions)}
            for r in range(runs)
        }
        signals = [Signal(name, "rad", sd=NOISE) for name in self.positions]
        return Measurement.from_runs(table, signals=signals, commands=self.commands)


PENDULUM = Rig(
    "pendulum",
    """<mujoco><option timestep="0.005" integrator="RK4"/><worldbody><body name="rod">
      <joint name="hinge" type="hinge" axis="0 1 0" damping="0.03"/>
      <inertial pos="0 0 -0.4" mass="1" diaginertia="0.01 0.01 0.001"/>
    </body></worldbody><actuator><motor name="motor" joint="hinge"/></actuator></mujoco>""",
    ParameterSpace({"body.rod.mass": Parameter(0.3, 3.0, "kg"), "joint.hinge.damping": Parameter(0.0, 0.5)}),
    (1.2, 0.05),
    (1.2,),
)
ARM = Rig(
    "arm",
    """<mujoco><option timestep="0.005" integrator="RK4"/><worldbody><body name="upper">
      <joint name="shoulder" type="hinge" axis="0 1 0" damping="0.2"/>
      <inertial pos="0 0 -0.2" mass="2" diaginertia="0.03 0.03 0.003"/>
      <body name="fore" pos="0 0 -0.4">
        <joint name="elbow" type="hinge" axis="0 1 0" damping="0.1"/>
        <inertial pos="0 0 -0.15" mass="1" diaginertia="0.01 0.01 0.001"/>
      </body></body></worldbody>
    <actuator><motor name="lift" joint="shoulder"/><motor name="bend" joint="elbow"/></actuator></mujoco>""",
    ParameterSpace(
        {
            "body.upper.mass": Parameter(0.5, 5.0, "kg"),
            "body.fore.mass": Parameter(0.3, 3.0, "kg"),
            "joint.shoulder.damping": Parameter(0.0, 1.0),
            "joint.elbow.damping": Parameter(0.0, 1.0),
        }
    ),
    (2.4, 0.8, 0.25, 0.12),
    (4.0, 1.0),
)
