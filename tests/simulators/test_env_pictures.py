"""Pictures of an environment: one on request, or one a step among what is observed."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torchrl.envs.utils import check_env_specs

from envs.cartpole import CartPole, CartPoleTask
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import SimulatorEnv

SPACE = ParameterSpace({"length": Parameter(0.1, 1.0, "m")})


def test_a_picture_shows_where_the_world_stands_and_how_long_its_pole_is() -> None:
    env = SimulatorEnv(CartPole(SPACE, 2), CartPoleTask(), picture_size=(60, 80))
    start = env.reset()
    start["theta"] = torch.tensor([[0.2], [1.0]], dtype=torch.float64)
    env.reset(start)
    short, long = (env.render(world=w) for w in (0, 1))
    assert (short.shape, short.dtype) == ((60, 80, 3), np.uint8)
    assert not np.array_equal(short, long), "the poles differ"
    assert np.array_equal(short, env.render(world=0)), "nothing has moved"
    for _ in range(15):
        env.step(env.rand_action(start))
    assert not np.array_equal(short, env.render(world=0))


def test_pictures_are_observed_in_every_reset_and_step() -> None:
    env = SimulatorEnv(CartPole(SPACE, 2), CartPoleTask(), from_pixels=True, picture_size=(30, 40))
    check_env_specs(env)
    data = env.rollout(4, break_when_any_done=False)
    assert data["pixels"].shape == (2, 4, 30, 40, 3)
    assert data["pixels"].dtype == torch.uint8
    assert torch.equal(data["next", "pixels"][:, :-1], data["pixels"][:, 1:])
    assert (data["pixels"] < 255).any(), "something is drawn"


def test_another_mode_is_one_line() -> None:
    with pytest.raises(BadInput, match="rgb_array"):
        SimulatorEnv(CartPole(SPACE), CartPoleTask()).render("human")
