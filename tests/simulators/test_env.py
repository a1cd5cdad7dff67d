"""SimulatorEnv keeps TorchRL's promises: specs, partial resets, truncation, seeds, worlds that diverge."""

from __future__ import annotations

import copy

import gymnasium
import pytest
import torch
from tensordict import TensorDict
from torchrl.collectors import Collector
from torchrl.envs import EnvBase, check_env_specs

from envs.cartpole import CartPole, CartPoleTask
from envs.pendulum import Pendulum, PendulumTask
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Simulator, SimulatorEnv
from onlinebayes.simulators.testing import check_env

FREE = ["length", "mass"]


def _cartpole(worlds: int = 5, horizon: int = 500, seed: int = 0) -> SimulatorEnv:
    return SimulatorEnv(CartPole(FREE, worlds), CartPoleTask(horizon), seed=seed)


def _pendulum(worlds: int = 5, horizon: int = 20, seed: int = 0) -> SimulatorEnv:
    return SimulatorEnv(Pendulum(FREE, worlds), PendulumTask(horizon), seed=seed)


@pytest.mark.parametrize("env", [_cartpole(), _pendulum(), _cartpole(worlds=1)], ids=["cartpole", "pendulum", "one"])
def test_specs(env: EnvBase) -> None:
    check_env_specs(env)
    data = env.rollout(50, break_when_any_done=False)
    assert data["observation"].dtype == data["next", "reward"].dtype == torch.float32
    assert data["theta"].dtype == torch.float64


class Wrapped(Simulator):
    """A simulator of another backend: the interface and nothing beyond it."""

    def __init__(self, inner: Simulator) -> None:
        self._inner = inner
        for name in ("parameters", "worlds", "dt", "timestep", "commands", "signals", "effects", "device", "dtype"):
            setattr(self, name, getattr(inner, name))

    nominal = property(lambda self: self._inner.nominal)
    state = property(lambda self: self._inner.state)
    theta = property(lambda self: self._inner.theta)
    failed = property(lambda self: self._inner.failed)

    def reset(self, theta, state=None, mask=None):
        return self._inner.reset(theta, state, mask)

    def step(self, inputs):
        return self._inner.step(inputs)

    def rollout(self, theta, state, inputs, times):
        raise AssertionError

    def read(self, state):
        raise AssertionError

    def with_effect(self, effect):
        raise AssertionError

    def with_worlds(self, worlds):
        raise AssertionError


@pytest.mark.parametrize("make", [_cartpole, _pendulum], ids=["cartpole", "pendulum"])
def test_conformance(make) -> None:
    check_env(make)


def test_any_simulator_will_do() -> None:
    check_env_specs(SimulatorEnv(Wrapped(CartPole(FREE, 3)), CartPoleTask()))


def test_episodes_are_truncated_at_the_horizon_and_counted_world_by_world() -> None:
    data = _cartpole(worlds=16, horizon=13).rollout(100, break_when_any_done=False)
    for world in data.unbind(0):
        length = 0
        for step in world["next"].unbind(0):
            length += 1
            assert bool(step["truncated"]) == (length == 13)
            assert bool(step["done"]) == bool(step["truncated"] | step["terminated"])
            length = 0 if step["done"] else length
    assert data["next", "terminated"].any()
    assert data["next", "truncated"].any()


def test_worlds_that_did_not_end_go_on_untouched() -> None:
    data = _cartpole(worlds=16).rollout(100, break_when_any_done=False)
    ended = data["next", "done"][:, :-1, 0]
    same = (data["observation"][:, 1:] == data["next", "observation"][:, :-1]).all(-1)
    assert torch.equal(same, ~ended)
    assert (data["observation"][:, 1:][ended].abs() <= 0.05).all()


def test_a_reset_takes_theta_for_the_worlds_it_resets() -> None:
    env = _cartpole(worlds=3)
    first = torch.tensor([[0.2, 0.3], [0.4, 0.5], [0.6, 0.7]], dtype=torch.float64)
    state = env.reset(TensorDict({"theta": first}, batch_size=(3,)))
    assert torch.equal(state["theta"], first)
    state = env.step(env.rand_action(state))["next"]
    state["_reset"] = torch.tensor([[False], [True], [False]])
    state["theta"] = 1.0 - first
    env.reset(state)
    expected = torch.where(torch.tensor([[False], [True], [False]]), 1.0 - first, first)
    assert torch.equal(env.simulator.theta, expected)
    assert env.reset()["theta"].equal(expected)  # without theta the worlds keep theirs


def test_seeds_repeat_starts_and_differ() -> None:
    starts = [_cartpole(seed=seed).reset()["observation"] for seed in (1, 1, 2)]
    assert torch.equal(starts[0], starts[1])
    assert not torch.equal(starts[0], starts[2])
    env = _cartpole(seed=2)
    env.set_seed(1)
    assert torch.equal(env.reset()["observation"], starts[0])


def test_a_diverging_world_ends_its_episode_with_finite_data() -> None:
    env = _pendulum(worlds=3)
    state = env.reset()
    state["action"] = torch.tensor([[0.1], [float("nan")], [0.1]])
    after = env.step(state)["next"]
    assert after["terminated"].flatten().tolist() == [False, True, False]
    assert after["done"].flatten().tolist() == [False, True, False]
    assert after["reward"].isfinite().all()
    assert torch.equal(after["observation"][1], state["observation"][1])
    after["_reset"] = after["done"].clone()
    assert not env.reset(after)["done"].any()
    assert not env.simulator.failed.any()


def test_returns_are_gymnasiums() -> None:
    # The same policy, always left, falls after 8 to 10 steps in both; means of 2000 and 300 episodes differ by less
    # than 5 standard errors (false failure below 1e-6).
    env, lengths = _cartpole(worlds=2000), []
    data = env.rollout(15, policy=_always_left, break_when_any_done=False)
    ours = data["next", "done"][..., 0].int().argmax(1).double() + 1
    reference = gymnasium.make("CartPole-v1")
    for seed in range(300):
        reference.reset(seed=seed)
        steps, over = 0, False
        while not over:
            over, steps = reference.step(0)[2], steps + 1
        lengths.append(steps)
    theirs = torch.tensor(lengths, dtype=torch.float64)
    error = (ours.var() / len(ours) + theirs.var() / len(theirs)).sqrt()
    assert (ours.mean() - theirs.mean()).abs() < 5 * error


def test_through_a_collector() -> None:
    collector = Collector(_cartpole(worlds=8), frames_per_batch=8 * 50, total_frames=8 * 100, track_traj_ids=False)
    batches = list(collector)
    assert [batch.batch_size for batch in batches] == [torch.Size([8, 50])] * 2
    # The second batch goes on where the first one ended.
    last, first = batches[0][:, -1]["next"], batches[1][:, 0]
    going_on = ~last["done"][:, 0]
    assert torch.equal(last["observation"][going_on], first["observation"][going_on])


def test_it_stays_on_the_simulators_device() -> None:
    env = _cartpole()
    assert env.to("cpu") is env
    with pytest.raises(BadInput, match="on cpu, not meta; build its simulator on that device"):
        env.to("meta")


@pytest.mark.gpu
def test_on_a_gpu() -> None:
    env = SimulatorEnv(CartPole(FREE, 64, device="cuda"), CartPoleTask(), with_state=True)
    check_env_specs(env)
    assert env.rollout(50, break_when_any_done=False).device.type == "cuda"
    env.set_seed(3)
    start = env.reset()
    saved = {key: value.cpu() if isinstance(value, torch.Tensor) else value for key, value in _flat(env).items()}
    first = env.rollout(30, _always_left, auto_reset=False, tensordict=start, break_when_any_done=False)
    env.set_extra_state(saved)
    again = env.rollout(30, _always_left, auto_reset=False, tensordict=start, break_when_any_done=False)
    assert torch.equal(first["next", "observation"], again["next", "observation"])
    assert copy.deepcopy(env).reset()["observation"].device.type == "cuda"
    state = env.get_state()
    assert torch.equal(env.reset(state, set_state=True)["state", "qpos"], state["state", "qpos"])
    assert env.render().shape == (240, 320, 3)


def _flat(env: SimulatorEnv) -> dict[str, object]:
    """The state as a checkpoint that was read on the CPU gives it."""
    state = env.get_extra_state()
    simulator = {key: value.cpu() if isinstance(value, torch.Tensor) else value
                 for key, value in state["simulator"].items()}  # fmt: skip
    return {**state, "simulator": simulator}


def _always_left(tensordict: TensorDict) -> TensorDict:
    left = torch.tensor([1, 0]).expand(*tensordict.batch_size, 2)
    return tensordict.set("action", left)
