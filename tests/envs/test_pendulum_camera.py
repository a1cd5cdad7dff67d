"""The camera: what a frame shows, one light an episode, worlds that go on, and the state that it keeps."""

from __future__ import annotations

import torch
from tensordict import TensorDict
from torchrl.envs import TransformedEnv
from torchrl.envs.utils import check_env_specs

from envs.pendulum import Pendulum, PendulumTask
from envs.pendulum_camera import HIGH, LOW, SIZE, PendulumCamera, frames
from onlinebayes.inference import BoxUniform
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.transforms import ParameterRandomization
from recipes.pendulum import SPACE


def filmed(worlds: int, seed: int = 0, horizon: int = 5) -> TransformedEnv:
    env = SimulatorEnv(Pendulum(SPACE).with_worlds(worlds), PendulumTask(horizon), seed=1)
    env = TransformedEnv(env, ParameterRandomization(BoxUniform(SPACE)))
    env.append_transform(PendulumCamera(seed=seed))
    return env


def lights(number: int) -> torch.Tensor:
    low, high = torch.tensor(LOW), torch.tensor(HIGH)
    return low + (high - low) * torch.rand(number, len(LOW), generator=torch.Generator().manual_seed(0))


def test_many_frames_are_those_of_each_alone() -> None:
    angle, light = torch.linspace(-3, 3, 6), lights(6)
    noise = torch.randn(6, SIZE, SIZE, generator=torch.Generator().manual_seed(1))
    together = frames(angle, light, noise)
    alone = torch.stack([frames(*one) for one in zip(angle, light, noise, strict=True)])
    assert torch.equal(together, alone)


def test_the_brightest_place_is_the_hand() -> None:
    angle = torch.linspace(-3, 3, 12)
    light = torch.tensor((0.3, 0.0, 0.0, 0.4, 0.0)).expand(12, -1)
    seen = frames(angle, light, torch.zeros(12, SIZE, SIZE)).double().squeeze(1)
    weight = (seen - seen.amin((1, 2), keepdim=True)).square()
    line = torch.linspace(-1, 1, SIZE, dtype=torch.float64)
    x, y = (weight * line).sum((1, 2)), (weight * -line[:, None]).sum((1, 2))
    found = torch.atan2(x, y)
    assert torch.allclose(found, angle.double(), atol=0.02)


def test_specs_hold() -> None:
    check_env_specs(filmed(3), seed=0)


def test_an_episode_has_one_light_and_frames_follow_each_other() -> None:
    env = filmed(4)
    seen = env.rollout(5, break_when_any_done=False)
    assert torch.equal(seen["light"], seen["light"][:, :1].expand_as(seen["light"]))
    assert len(seen["light"][:, 0].unique(dim=0)) == 4
    after = seen["next", "pixels"]
    assert torch.equal(after[:, 1:, 0], after[:, :-1, 1])
    assert torch.equal(after[:, 1:, 1], after[:, :-1, 2])
    assert not torch.equal(after[:, 1:, 2], after[:, :-1, 2])


def test_worlds_that_go_on_keep_light_and_frames() -> None:
    env = filmed(3)
    before = env.rand_step(env.reset())["next"]
    reset = TensorDict({"_reset": torch.tensor([[True], [False], [False]])}, [3])
    after = env.reset(before.clone().update(reset))
    for key in ("light", "pixels"):
        assert torch.equal(after[key][1:], before[key][1:])
        assert not torch.equal(after[key][:1], before[key][:1])
    assert torch.equal(after["pixels"][0, 0], after["pixels"][0, 2])


def test_it_goes_on_from_its_state() -> None:
    one, other = PendulumCamera(seed=3), PendulumCamera(seed=4)
    told = TensorDict({"observation": torch.tensor([[1.0, 0.0, 0.0]])}, [1])
    one._reset(TensorDict(batch_size=[1]), told.clone())
    other.load_state_dict(one.state_dict())
    first, second = (camera._reset(TensorDict(batch_size=[1]), told.clone()) for camera in (one, other))
    assert torch.equal(first["pixels"], second["pixels"])
