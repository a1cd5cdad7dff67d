"""Environments of others with theta: it reaches exactly the worlds that reset, and every step carries it."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from functools import partial

import gymnasium
import pytest
import torch
from tensordict import TensorDict
from torchrl.envs import EnvBase, GymWrapper, ParallelEnv, SerialEnv, TransformedEnv, check_env_specs

from onlinebayes.inference import BoxUniform
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Parameterized
from onlinebayes.transforms import ParameterRandomization

SPACE = ParameterSpace({"m": Parameter(0.1, 1.0, "kg"), "l": Parameter(0.1, 1.0, "m")})


def change(env: gymnasium.Env, values: Mapping[str, float]) -> None:
    env.unwrapped.m, env.unwrapped.l = values["m"], values["l"]


def pendulum(steps: int = 6) -> Parameterized:
    return Parameterized(GymWrapper(gymnasium.make("Pendulum-v1", max_episode_steps=steps)), SPACE, change)


def inner(env: EnvBase) -> gymnasium.Env:
    return env.base_env._env.unwrapped


def drawn(env: EnvBase) -> TransformedEnv:
    return TransformedEnv(env, ParameterRandomization(BoxUniform(SPACE)))


def test_a_single_environment_is_changed_at_every_reset() -> None:
    env = drawn(pendulum())
    check_env_specs(env)
    data = env.rollout(20, break_when_any_done=False)
    theta = data["theta"]
    assert theta.dtype == torch.float64
    assert SPACE.contains(theta).all()
    for begin in (0, 6, 12):
        assert (theta[begin : begin + 6] == theta[begin]).all()
    assert len(theta.unique(dim=0)) == 4
    assert [inner(env).m, inner(env).l] == data["next", "theta"][-1].tolist()


def test_physics_follow_theta() -> None:
    env, state = pendulum(), [0.5, 0.0]
    rates = []
    for mass in (0.1, 1.0):
        env.reset(TensorDict({"theta": torch.tensor([mass, 1.0]).double()}))
        inner(env).state = state
        rates.append(float(env.step(TensorDict({"action": torch.ones(1)}))["next", "observation"][2]))
    assert rates[0] - rates[1] == pytest.approx(3 * 0.05 * (1 / 0.1 - 1 / 1.0), rel=1e-4)


def test_without_theta_worlds_keep_theirs_at_first_the_nominal_one() -> None:
    env = Parameterized(
        GymWrapper(gymnasium.make("Pendulum-v1")), SPACE, change, nominal=torch.tensor([0.3, 0.4], dtype=torch.float64)
    )
    assert env.reset()["theta"].tolist() == [0.3, 0.4]
    env.reset(TensorDict({"theta": torch.tensor([0.7, 0.8], dtype=torch.float64)}))
    assert env.reset()["theta"].tolist() == [0.7, 0.8]
    assert pendulum().reset()["theta"].tolist() == pytest.approx([0.55, 0.55])


@pytest.mark.parametrize("batched", [SerialEnv, pytest.param(ParallelEnv, marks=pytest.mark.slow)])
def test_batched_environments_hand_each_world_its_own(batched: type[EnvBase]) -> None:
    """The worlds end at different steps, so that resets are partial."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of processes that are forked
        env = drawn(batched(3, [partial(pendulum, steps) for steps in (3, 4, 6)]))
        data = env.rollout(12, break_when_any_done=False)
        env.close()
    theta = data["theta"][..., 0]
    for world, steps in enumerate((3, 4, 6)):
        changes = (theta[world, 1:] != theta[world, :-1]).nonzero()[:, 0] + 1
        assert changes.tolist() == list(range(steps, 12, steps))
    assert (
        data["next", "theta"][:, :-1][~data["next", "done"][:, :-1, 0]]
        == data["theta"][:, 1:][~data["next", "done"][:, :-1, 0]]
    ).all()


def test_apply_is_called_for_the_worlds_that_reset_alone() -> None:
    calls: list[float] = []

    def noted(env: gymnasium.Env, values: Mapping[str, float]) -> None:
        calls.append(values["m"])
        change(env, values)

    def make(steps: int) -> Parameterized:
        return Parameterized(GymWrapper(gymnasium.make("Pendulum-v1", max_episode_steps=steps)), SPACE, noted)

    env = drawn(SerialEnv(2, [partial(make, 4), partial(make, 100)]))
    data = env.rollout(9, break_when_any_done=False)
    assert len(calls) == 2 + 2
    assert calls[2:] == data["theta"][0, [4, 8], 0].tolist()


@pytest.mark.parametrize("value", [float("nan"), -1.0, 2.0])
def test_theta_outside_its_bounds_is_refused(value: float) -> None:
    with pytest.raises(BadInput, match=r"m = .* it must lie in"):
        pendulum().reset(TensorDict({"theta": torch.tensor([value, 0.5]).double()}))


def test_an_environment_without_parameters_is_refused_by_the_transform() -> None:
    with pytest.raises(BadInput, match="SerialEnv does not read 'theta'"):
        drawn(SerialEnv(2, lambda: GymWrapper(gymnasium.make("Pendulum-v1")))).reset()
