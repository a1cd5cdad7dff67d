"""Pendulum equals Gymnasium's, whatever its parameters, where torque and speed are cut off too."""

from __future__ import annotations

import numpy as np
import torch

from envs.pendulum import PendulumTask


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
