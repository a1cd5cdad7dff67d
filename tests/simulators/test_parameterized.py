"""Environments of others with theta: it reaches exactly the worlds that reset, and every step carries it."""

from __future__ import annotations

import copy
import pickle
import warnings
from collections.abc import Callable, Mapping
from functools import partial

import gymnasium
import pytest
import torch
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from tensordict import TensorDict
from torchrl.collectors import Collector
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs import EnvBase, GymWrapper, ParallelEnv, SerialEnv, TransformedEnv, check_env_specs

from onlinebayes.inference import BoxUniform
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Parameterized
from onlinebayes.simulators.testing import check_parameterized
from onlinebayes.transforms import ParameterRandomization

SPACE = ParameterSpace({"m": Parameter(0.1, 1.0, "kg"), "l": Parameter(0.1, 1.0, "m")})


def change(env: gymnasium.Env, values: Mapping[str, float]) -> None:
    env.unwrapped.m, env.unwrapped.l = values["m"], values["l"]


def pendulum(steps: int = 6) -> Parameterized:
    return Parameterized(GymWrapper(gymnasium.make("Pendulum-v1", max_episode_steps=steps)), SPACE, change)


def vectorised(steps: int = 50, mode: AutoresetMode = AutoresetMode.DISABLED) -> Parameterized:
    make = partial(gymnasium.make, "Pendulum-v1", max_episode_steps=steps)
    return Parameterized(GymWrapper(SyncVectorEnv([make] * 3, autoreset_mode=mode)), SPACE, change)


class Mass(EnvBase):
    """x'' = action l / m: an environment of one's own, of any batch size."""

    def __init__(self, *batch: int) -> None:
        super().__init__(batch_size=batch)
        self.observation_spec = Composite(x=Unbounded((*batch, 2)), shape=batch)
        self.action_spec, self.reward_spec = Bounded(-1, 1, (*batch, 1)), Unbounded((*batch, 1))
        self.m = self.l = torch.ones(batch)
        self.generator = torch.Generator()

    def _reset(self, tensordict: TensorDict | None = None, **kwargs: object) -> TensorDict:
        start = torch.rand(*self.batch_size, 2, generator=self.generator)
        reset = None if tensordict is None else tensordict.get("_reset", None)
        self.x = start if reset is None else torch.where(reset, start, self.x)
        return TensorDict({"x": self.x}, self.batch_size)

    def _step(self, tensordict: TensorDict) -> TensorDict:
        push = (self.l / self.m).float().unsqueeze(-1) * tensordict["action"]
        self.x = self.x + 0.1 * torch.cat([self.x[..., 1:], push], -1)
        off = torch.zeros(*self.batch_size, 1, dtype=torch.bool)
        return TensorDict({"x": self.x, "reward": -self.x[..., :1], "done": off, "terminated": off}, self.batch_size)

    def _set_seed(self, seed: int | None) -> None:
        self.generator.manual_seed(seed or 0)


def own(*batch: int) -> Parameterized:
    def set_masses(env: Mass, values: Mapping[str, torch.Tensor]) -> None:
        env.m, env.l = (torch.as_tensor(values[name]) for name in ("m", "l"))

    return Parameterized(Mass(*batch), SPACE, set_masses)


def inner(env: EnvBase) -> gymnasium.Env:
    return env.base_env._env.unwrapped


def drawn(env: EnvBase) -> TransformedEnv:
    return TransformedEnv(env, ParameterRandomization(BoxUniform(SPACE)))


@pytest.mark.parametrize(
    "make",
    [partial(pendulum, 50), vectorised, own, partial(own, 4), partial(own, 2, 2)],
    ids=["gymnasium", "vectorised", "own", "own batched", "own of two dimensions"],
)
def test_conforms(make: Callable[[], Parameterized]) -> None:
    check_parameterized(make, SPACE)


def test_the_check_finds_parameters_that_do_nothing() -> None:
    def make() -> Parameterized:
        return Parameterized(GymWrapper(gymnasium.make("Pendulum-v1")), SPACE, lambda env, values: None)

    with pytest.raises(AssertionError, match="change nothing"):
        check_parameterized(make, SPACE)


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


def test_bounds_are_those_of_theta_in_single_precision() -> None:
    space = ParameterSpace({"m": Parameter(0.1, 0.7, "kg"), "l": Parameter(0.3, 1.0, "m")})
    env = Parameterized(GymWrapper(gymnasium.make("Pendulum-v1")), space, change)
    theta = env.reset(TensorDict({"theta": torch.tensor([0.7, 0.3])}))["theta"]
    assert space.contains(theta)


def test_copies_have_a_world_of_their_own() -> None:
    env = pendulum()
    env.reset(TensorDict({"theta": torch.tensor([0.5, 0.5]).double()}))
    for other in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        assert other.reset()["theta"].tolist() == [0.5, 0.5]
        other.reset(TensorDict({"theta": torch.tensor([0.25, 0.25]).double()}))
        assert (inner(other).m, inner(env).m) == (0.25, 0.5)


def test_a_collector_makes_it() -> None:
    make = partial(SerialEnv, 2, pendulum)
    collector = Collector(lambda: drawn(make()), frames_per_batch=40, total_frames=40)
    (data,) = [batch.clone() for batch in collector]
    collector.shutdown()
    ended = data["next", "done"][:, :-1, 0]
    changed = (data["theta"][:, 1:] != data["theta"][:, :-1]).any(-1)
    assert torch.equal(changed, ended)
    assert ended.sum() == 6


def test_worlds_of_a_vector_environment_are_set_one_by_one() -> None:
    env = drawn(vectorised(5))
    data = env.rollout(7, break_when_any_done=False)
    worlds = env.base_env.base_env._env.envs
    assert [world.unwrapped.m for world in worlds] == data["next", "theta"][:, -1, 0].tolist()
    assert (data["theta"][:, 4] != data["theta"][:, 5]).any(-1).all()


def asynchronous() -> GymWrapper:
    class Elsewhere(SyncVectorEnv):
        """As ``AsyncVectorEnv``, whose worlds are in other processes."""

        parent_pipes = ()

    make = partial(gymnasium.make, "Pendulum-v1")
    return GymWrapper(Elsewhere([make] * 2, autoreset_mode=AutoresetMode.DISABLED))


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (partial(vectorised, mode=AutoresetMode.SAME_STEP), "reset themselves .* autoreset_mode"),
        (lambda: Parameterized(SerialEnv(2, Mass), SPACE, change), "worlds of SerialEnv cannot be reached"),
        (lambda: Parameterized(asynchronous(), SPACE, change), "worlds of Elsewhere cannot be reached"),
        (lambda: Parameterized(pendulum(), SPACE, change), "has 'theta' already"),
    ],
)
def test_worlds_that_cannot_be_given_theta_are_refused(make: Callable[[], EnvBase], said: str) -> None:
    with pytest.raises(BadInput, match=said):
        make()


def test_two_sets_of_parameters_have_two_keys() -> None:
    gravity = ParameterSpace({"g": Parameter(5.0, 15.0, "m/s2")})
    env = Parameterized(
        pendulum(), gravity, lambda env, values: setattr(env.unwrapped, "g", values["g"]), theta_key=("world", "theta")
    )
    data = env.reset(TensorDict({"world": {"theta": torch.tensor([7.0])}, "theta": torch.tensor([0.25, 0.5]).double()}))
    assert data["world", "theta"].tolist() == [7.0]
    assert (inner(env.base_env).g, inner(env.base_env).m) == (7.0, 0.25)
