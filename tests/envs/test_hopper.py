from __future__ import annotations

import mujoco
import pytest
import torch
from tensordict import TensorDict
from torchrl.envs import TransformedEnv
from torchrl.envs.utils import check_env_specs

from envs.hopper import DT, MODEL, PHYSICAL, HopperTask, hopper
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.simulators.testing import check_simulator
from onlinebayes.transforms import ParameterRandomization
from recipes.studies.speed_hopper import Bench, UniformPhysics, collected, raw, stepped


def test_twenty_parameters_whose_nominal_values_are_physical() -> None:
    simulator = hopper()
    assert len(PHYSICAL) == 20
    assert bool(PHYSICAL.contains(simulator.nominal))
    assert simulator.dt == DT
    assert simulator.commands == ("hip", "knee", "ankle")


def test_conformance() -> None:
    # In the air, where the foot's contact and its softness do not act.
    check_simulator(hopper(), steps=12, inert=("geom.foot.friction[0]", "geom.foot.solref[0]"))


def test_every_parameter_acts_on_the_ground() -> None:
    simulator = hopper(worlds=20)
    torch.manual_seed(3)
    theta = simulator.nominal.expand(21, -1).clone()
    theta[1:].diagonal().copy_(torch.where(simulator.nominal < PHYSICAL.high * 0.9, PHYSICAL.high, PHYSICAL.low))
    start = TensorDict({"qpos": torch.zeros(21, 6).double(), "qvel": torch.zeros(21, 6).double()}, batch_size=[21])
    command = (2 * torch.rand(1, 40, 3, dtype=torch.float64) - 1).expand(21, -1, -1)
    times = DT * torch.arange(1, 41, dtype=torch.float64)
    path = simulator.rollout(theta, start, TensorDict({"command": command}, batch_size=[21, 40]), times)
    assert bool(path["valid"].all())
    moved = (path["qpos"][1:] - path["qpos"][:1]).abs().amax((1, 2))
    assert bool((moved > 1e-4).all()), dict(zip(PHYSICAL, moved.tolist(), strict=True))


def test_it_stands_by_itself_for_a_while_and_falls_when_pushed() -> None:
    simulator, task = hopper(worlds=2), HopperTask()
    simulator.reset(simulator.nominal.expand(2, -1))
    command = torch.zeros(2, 3, dtype=torch.float64)
    command[1] = torch.tensor([1.0, -1.0, 1.0])
    for _ in range(100):
        state = simulator.step(TensorDict({"command": command}, batch_size=[2]))
    assert task.terminated(state).tolist() == [False, True]
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    # The foot's lowest point touches the ground when all coordinates are 0.
    assert data.geom("foot").xpos[2] == pytest.approx(model.geom("foot").size[0])


def test_reward_is_speed_and_one_less_the_effort() -> None:
    task = HopperTask()
    before = TensorDict({"qpos": torch.zeros(2, 6), "qvel": torch.zeros(2, 6)}, batch_size=[2])
    after = before.clone()
    after["qpos"][1, 0] = 0.016
    reward = task.reward(before, torch.tensor([[0.0, 0.0, 0.0], [1.0, -1.0, 0.5]]), after)
    assert torch.allclose(reward, torch.tensor([1.0, 3.0 - 0.00225]))


def test_env_specs_and_fresh_parameters_where_it_falls() -> None:
    env = TransformedEnv(SimulatorEnv(hopper(worlds=16), HopperTask()), ParameterRandomization(UniformPhysics()))
    check_env_specs(env)
    path = env.rollout(60, break_when_any_done=False)
    theta, over = path["theta"], path["next", "done"][..., 0]
    assert int(over.sum()) > 3
    changed = (theta[:, 1:] != theta[:, :-1]).any(-1)
    assert torch.equal(changed, over[:, :-1])
    assert bool(PHYSICAL.contains(theta).all())


@pytest.mark.parametrize("measure", [raw, stepped, collected])
def test_the_bench_measures_a_rate(measure) -> None:
    assert measure(Bench(worlds=8, threads=1, seconds=0.01))() > 100.0
