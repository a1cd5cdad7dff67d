"""Both mountain cars beyond what Gymnasium says of them: the simulator's contract, the walls, the way out."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torchrl.envs.utils import check_env_specs

from envs.mountain_car import (
    HIGH,
    LOW,
    MountainCar,
    MountainCarContinuous,
    MountainCarContinuousTask,
    MountainCarTask,
    Valley,
)
from onlinebayes.parameters import Parameter
from onlinebayes.simulators import SimulatorEnv, Task
from onlinebayes.simulators.effects import ActuatorDelay, ViscousFriction
from onlinebayes.simulators.testing import check_simulator

CARS = [(MountainCar, MountainCarTask, "force"), (MountainCarContinuous, MountainCarContinuousTask, "power")]


@pytest.mark.usefixtures("without_shape_checks")
@pytest.mark.parametrize(("car", "task", "strength"), CARS)
def test_conformance(car: type[Valley], task: type[Task], strength: str) -> None:
    simulator = car((strength, "gravity"), 2)
    check_simulator(simulator, steps=4, atol=1e-12)
    braked = simulator.with_effect(ViscousFriction("car", Parameter(0.0, 0.1)))
    check_simulator(braked.with_effect(ActuatorDelay("engine", Parameter(0.0, 3.0, "s"))), steps=4, atol=1e-12)
    check_env_specs(SimulatorEnv(simulator, task()))


@pytest.mark.usefixtures("without_shape_checks")
@pytest.mark.parametrize(("car", "task", "strength"), CARS)
def test_pumping_gets_out_and_ends_the_episode(car: type[Valley], task: type[Task], strength: str) -> None:
    env = SimulatorEnv(car((), 20), task())
    forward = torch.eye(3, dtype=torch.int64)

    def pump(observation: torch.Tensor) -> torch.Tensor:
        ahead = observation[..., 1] >= 0
        return (2.0 * ahead - 1)[..., None] if strength == "power" else forward[2 * ahead.long()]

    policy = TensorDictModule(pump, ["observation"], ["action"])
    data = env.rollout(200, policy, break_when_all_done=True)
    arrived = data["next", "terminated"].any(1).squeeze(-1)
    assert arrived.all()
    first = data["next", "terminated"].squeeze(-1).long().argmax(-1)
    reward = data["next", "reward"].squeeze(-1)[range(20), first]
    torch.testing.assert_close(reward, torch.full((20,), 99.9 if strength == "power" else -1.0))
    # Full throttle all the time instead: the engine is too weak.
    stuck = torch.ones(20, 1) if strength == "power" else forward[2].expand(20, 3)
    held = env.rollout(150, TensorDictModule(lambda seen: stuck, ["observation"], ["action"]))
    assert not held["next", "terminated"].any()


def test_both_walls_stop_the_car() -> None:
    simulator = MountainCar((), 2)
    start = TensorDict({"qpos": torch.tensor([[-1.19], [0.59]]), "qvel": torch.tensor([[-0.07], [0.07]])}, [2])
    simulator.reset(simulator.nominal.expand(2, -1), start.double())
    after = simulator.step(TensorDict({"command": torch.zeros(2, 1)}, [2]))
    assert after["qpos"].squeeze(-1).tolist() == [LOW, HIGH]
    assert after["qvel"].squeeze(-1).tolist() == [0.0, 0.0]
