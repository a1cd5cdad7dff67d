"""Sensor noise has the size it is given, and what was seen once is not drawn again."""

from __future__ import annotations

import torch
from torchrl.envs import TransformedEnv

from onlinebayes.transforms import SensorNoise
from onlinebayes.transforms.testing import check_transform
from tests.transforms.systems import make_env

SD = (0.1, 0.0, 0.02, 0.5)


def test_conforms() -> None:
    check_transform(make_env, _transform, lambda: make_env().rollout(7, break_when_any_done=False))


def test_its_size_and_independence() -> None:
    # 4000 draws a value: the sample's sd is within 5 % of the truth (4.5 standard errors, false failure below 1e-5).
    clean = torch.zeros(40, 100, 4)
    noise = _transform()._apply_transform(clean).reshape(-1, 4)
    torch.testing.assert_close(noise.std(0), torch.tensor(SD), rtol=0.05, atol=0)
    assert noise[:, 1].eq(0).all()
    moving = noise[:, [0, 2, 3]]
    assert (torch.corrcoef(moving.T) - torch.eye(3)).abs().max() < 0.08
    assert abs(float((noise[1:, 0] * noise[:-1, 0]).mean()) / SD[0] ** 2) < 0.08


def test_the_true_state_stays_clean_and_seeds_repeat() -> None:
    envs = [TransformedEnv(make_env(worlds=4), SensorNoise(torch.tensor(SD), seed=seed)) for seed in (1, 1, 2)]
    seen = [env.reset()["observation"] for env in envs]
    assert torch.equal(seen[0], seen[1])
    assert not torch.equal(seen[0], seen[2])
    state = envs[0].base_env.simulator.state
    assert state["qpos"].abs().max() <= 0.05  # the start itself, whatever the sensors say
    assert (seen[0].double()[:, 0] - state["qpos"][:, 0]).abs().max() > 0.05


def _transform() -> SensorNoise:
    return SensorNoise(torch.tensor(SD), seed=0)
