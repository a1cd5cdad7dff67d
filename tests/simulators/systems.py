"""Random trials of torch systems, and the effects on CartPole, for the tests of torch simulators."""

from __future__ import annotations

import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.parameters import Parameter
from onlinebayes.simulators import TorchSimulator
from onlinebayes.simulators.effects import (
    ActuatorDelay,
    ActuatorGain,
    ConstantLoad,
    DryFriction,
    Effect,
    JointStiffness,
    QuadraticDrag,
    ViscousFriction,
)

FREE = ["length", "mass"]
CARTPOLE_EFFECTS: list[Effect] = [
    ViscousFriction("cart", Parameter(0, 10, "N s/m")),
    DryFriction("cart", Parameter(0, 10, "N")),
    QuadraticDrag("pole", Parameter(0, 10)),
    JointStiffness("pole", Parameter(0, 10), Parameter(-1, 1)),
    ConstantLoad("cart", Parameter(-10, 10, "N")),
    ActuatorGain("motor", Parameter(-0.5, 1)),
    ActuatorDelay("motor", Parameter(0, 0.1, "s")),
]


def all_effects(system: type[TorchSimulator], worlds: int, steps_per_dt: int = 1) -> TorchSimulator:
    simulator = system(FREE, worlds, dt=steps_per_dt * system.timestep)
    joint = system.joints[0].name
    return (
        simulator.with_effect(DryFriction(joint, Parameter(0, 0.5)))
        .with_effect(ViscousFriction(joint, Parameter(0, 0.5)))
        .with_effect(ActuatorDelay("motor", Parameter(0, 0.1, "s")))
    )


def draw(simulator: TorchSimulator, worlds: int, steps: int) -> tuple[Tensor, TensorDict, Tensor]:
    space, joints = simulator.parameters, len(simulator.joints)
    low = torch.where(
        space.low > 0, space.low.clamp(min=0.1), space.low
    )  # physical bounds are wide: keep to the middle
    theta = low + torch.rand(worlds, len(space), dtype=torch.float64) * (space.high.clamp(max=1.0) - low)
    q, v = 0.3 * torch.randn(2, worlds, joints, dtype=torch.float64)
    return theta, state_of(q, v), torch.rand(worlds, steps, 1, dtype=torch.float64) * 2 - 1


def state_of(q: list | Tensor, v: list | Tensor) -> TensorDict:
    q, v = (torch.as_tensor(x, dtype=torch.float64) for x in (q, v))
    return TensorDict({"qpos": q, "qvel": v}, batch_size=(len(q),))


def inputs(command: Tensor) -> TensorDict:
    return TensorDict({"command": command}, batch_size=command.shape[:-1])
