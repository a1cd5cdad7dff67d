from __future__ import annotations

import torch

from envs.cartpole import CartPole, CartPoleTask
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.transforms import SensorNoise
from onlinebayes.transforms.testing import check_transform

SD = torch.tensor([0.1, 0.0, 0.01, 1.0])


def make_env() -> SimulatorEnv:
    return SimulatorEnv(CartPole(worlds=8), CartPoleTask())


def test_conforms():
    check_transform(make_env, lambda: SensorNoise(SD), lambda: make_env().rollout(7, break_when_any_done=False))


def test_noise_has_the_standard_deviation_of_each_sensor():
    transform = SensorNoise(SD, seed=1)
    data = transform(make_env().rollout(3).select("observation").expand(2000, 8, 3).clone())
    spread = data["observation"].std(0).mean((0, 1))
    # 2000 draws in 24 places: a relative standard error of 0.3 %, 6 of them are allowed.
    torch.testing.assert_close(spread, SD, rtol=0.02, atol=1e-7)


def test_a_seed_repeats_the_noise():
    data = make_env().rollout(3).select("observation")
    first, again, other = (SensorNoise(SD, seed=s)(data.clone())["observation"] for s in (1, 1, 2))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)
