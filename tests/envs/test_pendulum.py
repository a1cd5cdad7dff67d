"""Pendulum equals Gymnasium's, whatever its parameters, where torque and speed are cut off too."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from envs.pendulum import Pendulum, PendulumTask
from tests.envs import gym

CASES = [{}, {"length": 0.1, "mass": 0.1}, {"length": 0.4, "mass": 0.9}, {"length": 1.0, "mass": 0.2, "gravity": 3.0}]


@pytest.mark.parametrize("changed", CASES)
def test_equals_gymnasium_over_200_steps(changed: dict[str, float]) -> None:
    generator = np.random.default_rng(2)
    start, actions = generator.uniform(-1, 1, 2) * (np.pi, 1), generator.uniform(-3, 3, (200, 1))
    states, rewards, _ = gym.trajectory(gym.pendulum(**changed), start, actions)

    simulator, task = Pendulum(["length", "mass", "gravity"]), PendulumTask()
    theta = simulator.parameters.vector({**Pendulum.defaults, **changed})[None]
    given = torch.as_tensor(start)
    state = simulator.reset(theta, TensorDict({"qpos": given[None, :1], "qvel": given[None, 1:]}, batch_size=(1,)))
    for k, action in enumerate(actions):
        u = torch.as_tensor(action)[None]
        after = simulator.step(TensorDict({"command": task.command(u)}, batch_size=(1,)))
        found = torch.cat((after["qpos"], after["qvel"]), dim=-1)[0].numpy()
        np.testing.assert_allclose(found, states[k], rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(task.reward(state, u, after).numpy(), rewards[k], rtol=1e-6, atol=1e-6)
        state = after
    if changed.get("length") == 0.1:
        assert np.abs(states[:, 1]).max() == 8.0  # the speed limit was met


def test_observation_and_start() -> None:
    task = PendulumTask()
    start = task.start(torch.zeros(1000, 2, dtype=torch.float64), torch.Generator().manual_seed(0))
    assert start["qpos"].abs().max() <= np.pi
    assert start["qpos"].abs().max() > 0.99 * np.pi
    assert start["qvel"].abs().max() <= 1.0
    observation = task.observe(start)
    assert observation.dtype == torch.float32
    torch.testing.assert_close(observation[:, :2].norm(dim=-1), torch.ones(1000))
    assert not task.terminated(start).any()
