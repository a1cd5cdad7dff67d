"""Recurrent actor-critic: memory that is cleared, carried and needed."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.collectors import Collector
from torchrl.data import Bounded, Categorical, Composite, OneHot, Unbounded
from torchrl.envs import Compose, EnvBase, TransformedEnv
from torchrl.envs.utils import ExplorationType, check_env_specs, set_exploration_type

from onlinebayes.objectives import ActorCriticSettings, Objective, PPOSettings, actor_critic, ppo
from onlinebayes.runs import BadInput

OBSERVATION, USUAL = Unbounded((3,)), ActorCriticSettings()


class Recall(EnvBase):
    """A cue +-1 is shown at the first step only; ``delay`` steps later the action that repeats it is worth 1.

    The clock is shown all the time, so that only the cue has to be remembered. Episodes have ``delay + 1`` steps, or
    differ in length by world with ``ragged``.
    """

    def __init__(self, n: int = 64, delay: int = 6, ragged: bool = False) -> None:
        super().__init__(batch_size=(n,))
        self.delay = torch.full((n,), delay) - (torch.arange(n) % delay if ragged else 0)
        self.observation_spec = Composite(observation=Unbounded((n, 2)), shape=(n,))
        self.action_spec, self.reward_spec = Categorical(2, shape=(n,)), Unbounded((n, 1))
        self.cue, self.time = torch.zeros(n), torch.zeros(n)

    def _reset(self, tensordict: TensorDictBase | None = None) -> TensorDict:
        mask = None if tensordict is None else tensordict.get("_reset", None)
        mask = torch.ones(self.batch_size, dtype=torch.bool) if mask is None else mask.reshape(self.batch_size)
        self.cue = torch.where(mask, torch.randint(2, self.batch_size).float(), self.cue)
        self.time = torch.where(mask, torch.zeros_like(self.time), self.time)
        return self._seen()

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        asked = self.time == self.delay
        right = tensordict["action"] == self.cue
        self.time = self.time + 1
        done = asked.unsqueeze(-1)
        return self._seen().update({"reward": (asked & right).float().unsqueeze(-1), "done": done, "terminated": done})

    def _seen(self) -> TensorDict:
        cue = torch.where(self.time == 0, 2 * self.cue - 1, torch.zeros_like(self.cue))
        return TensorDict({"observation": torch.stack([cue, (self.time == self.delay).float()], -1)}, self.batch_size)

    def _set_seed(self, seed: int | None) -> None:
        torch.manual_seed(0 if seed is None else seed)


def collected(env, objective, batches, steps):
    collector = Collector(
        env,
        objective.policy,
        frames_per_batch=steps * env.batch_size.numel(),
        total_frames=batches * steps * env.batch_size.numel(),
        auto_register_policy_transforms=False,
    )
    yield from collector
    collector.shutdown()


def score(env, policy) -> float:
    """Share of episodes in which the cue is repeated, acting without chance."""
    with set_exploration_type(ExplorationType.DETERMINISTIC), torch.no_grad():
        told = env.rollout(40, policy, break_when_any_done=False)["next"]
    return float(told["reward"].sum() / told["done"].sum())


def remembering(settings=USUAL, *, ragged: bool = False, n: int = 64, delay: int = 4):
    """An objective for the recall task and its environment."""
    plain = Recall(n, delay, ragged)
    objective = actor_critic(plain.observation_spec_unbatched, plain.action_spec_unbatched, settings)
    return objective, TransformedEnv(plain, Compose(*objective.transforms()))


@pytest.mark.usefixtures("without_shape_checks")
def test_recall_is_solved_with_memory_and_stays_at_chance_without():
    objective, env = remembering(ActorCriticSettings(width=32, learning_rate=2e-3, gamma=0.9))
    for data in collected(env, objective, 110, 10):
        objective.update(data)
    assert score(env, objective.policy) > 0.98

    plain = Recall(delay=4)
    settings = PPOSettings(minibatch=320, gamma=0.9)
    forgetful = ppo(plain.observation_spec_unbatched, plain.action_spec_unbatched, settings)
    for data in collected(plain, forgetful, 20, 10):
        forgetful.update(data)
    # 512 episodes: 4.5 standard deviations of a coin's share, a false failure in 100 000.
    assert abs(score(plain, forgetful.policy) - 0.5) < 0.1


def test_the_environment_it_asks_for_is_sound():
    objective, env = remembering()
    assert isinstance(objective, Objective)
    check_env_specs(env)
    start = env.reset()
    assert start["is_init"].all()
    assert not start["memory"].any()


def test_a_batch_is_unrolled_as_it_was_acted():
    # Worlds begin anew at different steps, and rows begin in the middle of episodes.
    objective, env = remembering(ragged=True, n=6)
    for data in collected(env, objective, 3, 9):
        network, inputs = objective.network, objective.inputs
        out, then = network.unroll(
            inputs.read(data), inputs.read(data, ("next",)), data["is_init"].squeeze(-1), data["memory"][:, 0]
        )
        torch.testing.assert_close(network.value(out), data["state_value"])
        one_by_one = objective.policy(data["next"].clone().set("is_init", torch.zeros_like(data["is_init"])))
        torch.testing.assert_close(network.value(then), one_by_one["state_value"])
    assert data["is_init"][:, 1:].any()
    assert data["memory"][:, 0].any()


def test_where_an_episode_begins_nothing_is_remembered():
    objective, _ = remembering()
    data = TensorDict({"observation": torch.randn(5, 2), "memory": torch.randn(5, 2, 64)}, (5,))
    data["is_init"] = torch.tensor([True, True, False, False, False]).unsqueeze(-1)
    empty = data.clone().set("memory", torch.zeros(5, 2, 64))
    same = (objective.policy(data)["state_value"] == objective.policy(empty)["state_value"]).squeeze(-1)
    assert same.tolist() == [True, True, False, False, False]


def batch(objective, n: int = 8, t: int = 12) -> TensorDict:
    """What a collector gives, with an end in the middle of each row."""
    data = TensorDict({"observation": torch.randn(n, t, 3), "memory": torch.zeros(n, t, 2, 64)}, (n, t))
    data["is_init"] = torch.zeros(n, t, 1, dtype=torch.bool)
    data["is_init"][:, [0, 5]] = True
    with torch.no_grad():
        data = objective.policy(data).exclude("logits", "loc", "scale")
    done = data["is_init"].roll(-1, 1)
    ends = {"done": done, "terminated": done & (torch.rand(n, t, 1) < 0.5), "reward": torch.randn(n, t, 1)}
    return data.update({"next": {"observation": torch.randn(n, t, 3), **ends}})


@pytest.mark.parametrize(
    "spec", [OneHot(2, dtype=torch.int64), Categorical(3), Bounded(torch.tensor([-2.0, 0.0]), torch.tensor([2.0, 1.0]))]
)
def test_it_acts_within_a_spec_and_gradient_reaches_every_weight(spec):
    objective = actor_critic(OBSERVATION, spec, ActorCriticSettings(normalise=True))
    data = batch(objective)
    assert spec.expand(*data.shape, *spec.shape).is_in(data["action"])
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        again = [objective.policy(data.select(*objective.policy.in_keys))["action"] for _ in range(2)]
    assert torch.equal(*again)
    before = {name: value.clone() for name, value in objective.network.named_parameters()}
    losses = objective.update(data)
    assert set(losses) == {"loss_policy", "loss_value", "loss_entropy", "grad_norm"}
    still = [name for name, value in objective.network.named_parameters() if torch.equal(before[name], value)]
    assert not still, f"no gradient reached {still}"
    assert objective.inputs.normalisation.count == data.numel()


def test_values_of_a_world_that_always_pays_one_are_its_discounted_sum():
    # Worlds that go on and worlds that end after 3 steps, all seen alike but for the clock.
    settings = ActorCriticSettings(gamma=0.5, lmbda=1.0, learning_rate=1e-2, max_grad_norm=10.0)
    objective = actor_critic(OBSERVATION, Categorical(2), settings)
    n, t = 16, 12
    clock = torch.arange(t).remainder(3).float()[None, :, None].expand(n, t, 1)
    begins, done = clock == 0, clock == 2
    kind = (torch.arange(n) % 2).float()[:, None, None].expand(n, t, 1)
    seen = torch.cat([kind, clock, torch.ones(n, t, 1)], -1)
    data = TensorDict({"observation": seen, "memory": torch.zeros(n, t, 2, 64), "is_init": begins}, (n, t))
    data["next"] = {"observation": seen + torch.tensor([0.0, 1.0, 0.0]), "reward": torch.ones(n, t, 1)}
    data["next"].update({"done": done, "terminated": done & (kind == 1)})
    data["action"] = torch.zeros(n, t, dtype=torch.int64)
    for _ in range(300):
        objective.update(data)
    out, _ = objective.network.unroll(seen, data["next", "observation"], begins.squeeze(-1), data["memory"][:, 0])
    value = objective.network.value(out)[:, :3, 0]
    # Rewards are scaled by 1 - gamma: 1 where worlds go on, else 1 - gamma^(steps left).
    torch.testing.assert_close(value[1], torch.tensor([0.875, 0.75, 0.5]), atol=0.03, rtol=0)
    assert (value[0] > value[1]).all()
    # A truncated episode is worth more than its rewards: the state after it counts.
    assert value[0, 2] > 0.55


def test_it_goes_on_bit_for_bit(tmp_path):
    def learnt(objective, updates):
        for _ in range(updates):
            objective.update(batch(objective))
        return objective

    first = learnt(actor_critic(OBSERVATION, Categorical(2), ActorCriticSettings(normalise=True)), 3)
    torch.save(first.state_dict(), tmp_path / "state.pt")
    second = actor_critic(OBSERVATION, Categorical(2), ActorCriticSettings(normalise=True))
    second.load_state_dict(torch.load(tmp_path / "state.pt", weights_only=True))
    for objective in (first, second):
        torch.manual_seed(1)
        learnt(objective, 3)
    for name, value in first.network.state_dict().items():
        assert torch.equal(value, second.network.state_dict()[name]), name


def test_what_cannot_be_is_refused_in_one_line():
    objective = actor_critic(OBSERVATION, Categorical(2))
    data = batch(objective)
    with pytest.raises(BadInput, match="no 'memory'"):
        objective.update(data.exclude("memory"))
    with pytest.raises(BadInput, match=r"rows \(N, T\)"):
        objective.update(data.reshape(-1))
    with pytest.raises(BadInput, match="4 wide, the policy was built for 3"):
        objective.update(data.set("observation", torch.randn(8, 12, 4)))
    with pytest.raises(BadInput, match="action spec"):
        actor_critic(OBSERVATION, Unbounded((2,)))
