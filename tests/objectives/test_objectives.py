from __future__ import annotations

import copy

import pytest
import torch
from tensordict import TensorDict
from torchrl.data import Bounded, Categorical, OneHot, Unbounded
from torchrl.envs.utils import ExplorationType, set_exploration_type

from onlinebayes.objectives import (
    PPOSettings,
    SACSettings,
    ddpg,
    ppo,
    sac,
    stochastic_policy,
)
from onlinebayes.runs import BadInput, seed_everything

OBSERVATION = Unbounded((3,))
BOUNDED = Bounded(torch.tensor([-2.0, 0.0]), torch.tensor([2.0, 1.0]))


def batch(policy, n: int = 8, t: int = 16, kind=ExplorationType.RANDOM) -> TensorDict:
    """What a collector gives of a bandit: reward 1 near the action (1.0, 0.5), an episode's end at each row's."""
    with set_exploration_type(kind):
        data = policy(TensorDict({"observation": torch.randn(n, t, 3)}, (n, t))).detach()
    done = torch.zeros(n, t, 1, dtype=torch.bool)
    done[:, -1] = True
    target = torch.tensor([1.0, 0.5])
    action = data["action"].float()
    reward = -(action - target).abs().sum(-1, keepdim=True) if action.shape[-1] == 2 else torch.ones(n, t, 1)
    data["next"] = TensorDict(
        {
            "observation": torch.randn(n, t, 3),
            "reward": reward,
            "done": done,
            "terminated": done.clone(),
            "truncated": torch.zeros_like(done),
        },
        (n, t),
    )
    return data


@pytest.mark.parametrize("spec", [OneHot(2, dtype=torch.int64), Categorical(3), BOUNDED])
def test_a_policy_acts_within_its_spec(spec):
    policy = stochastic_policy(OBSERVATION, spec, log_prob=True)
    data = policy(TensorDict({"observation": 10 * torch.randn(50, 3)}, (50,)))
    assert spec.expand(50, *spec.shape).is_in(data["action"])
    assert data["action_log_prob"].shape == (50,)
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        again = [policy(data.select("observation"))["action"] for _ in range(2)]
    assert torch.equal(*again)


def test_an_action_of_another_kind_is_refused():
    with pytest.raises(BadInput, match="OneHot"):
        stochastic_policy(OBSERVATION, Unbounded((2,)))
    with pytest.raises(BadInput, match="one world"):
        stochastic_policy(OBSERVATION, Bounded(-1, 1, (4, 2)))


SMALL = pytest.mark.parametrize(
    ("build", "settings"), [(ppo, PPOSettings(minibatch=32)), (sac, SACSettings(minibatch=32))]
)


@SMALL
def test_gradient_reaches_every_parameter(build, settings):
    objective = build(OBSERVATION, BOUNDED, settings)
    before = {name: value.clone() for name, value in objective.loss.named_parameters()}
    losses = objective.update(batch(objective.policy))
    assert all(torch.isfinite(torch.tensor(value)) for value in losses.values())
    still = [name for name, value in objective.loss.named_parameters() if torch.equal(before[name], value)]
    assert not still, f"no gradient reached {still}"


@pytest.mark.parametrize(
    ("build", "settings", "updates"),
    [
        (ppo, PPOSettings(minibatch=64, learning_rate=3e-3, gamma=0.5, entropy=0.0), 40),
        (sac, SACSettings(minibatch=64, learning_rate=3e-3, gamma=0.5, frames_per_update=16, alpha=0.05), 25),
    ],
)
def test_learns_a_bandit(build, settings, updates):
    # The best action is (1, 0.5); a policy that has learnt nothing scores about -1.4.
    objective = build(OBSERVATION, BOUNDED, settings)
    for _ in range(updates):
        objective.update(batch(objective.policy))
    reward = batch(objective.policy, kind=ExplorationType.DETERMINISTIC)["next", "reward"].mean()
    assert reward > -0.35


def test_ppo_leaves_the_batch_as_it_was():
    objective = ppo(OBSERVATION, OneHot(2, dtype=torch.int64), PPOSettings(minibatch=32))
    data = batch(objective.policy)
    before = data.clone()
    objective.update(data)
    assert (data == before).all()


@pytest.mark.parametrize(("target", "moves"), [(1e-9, -1), (1e3, 1), (None, 0)])
def test_ppos_learning_rate_follows_the_divergence(target, moves):
    objective = ppo(OBSERVATION, BOUNDED, PPOSettings(minibatch=32, learning_rate=1e-3, target_kl=target))
    for _ in range(3):
        objective.update(batch(objective.policy))
    rate = objective.optimiser.param_groups[0]["lr"]
    assert rate == pytest.approx(1e-3 * 1.5 ** (3 * moves))
    other = ppo(OBSERVATION, BOUNDED, PPOSettings(minibatch=32, target_kl=target))
    other.load_state_dict(objective.state_dict())
    assert other.optimiser.param_groups[0]["lr"] == rate


def test_ppo_refuses_a_batch_that_its_buffer_cannot_deal_out():
    objective = ppo(OBSERVATION, BOUNDED, PPOSettings(minibatch=64, frames_per_batch=128))
    for n in (3, 9):  # rows of 16
        with pytest.raises(BadInput, match=f"a batch of {16 * n} frames"):
            objective.update(batch(objective.policy, n))


def test_sac_memory_lets_old_worlds_fade():
    objective = sac(OBSERVATION, BOUNDED, SACSettings(memory=128, minibatch=16, frames_per_update=128))
    for value in (1.0, 2.0):
        data = batch(objective.policy)
        data["observation"] = torch.full_like(data["observation"], value)
        objective.update(data)
    assert len(objective.buffer) == 128
    assert (objective.buffer.sample(500)["observation"] == 2.0).all()


@SMALL
def test_state_dict_continues_bit_for_bit(build, settings):
    def fresh():
        return build(OBSERVATION, BOUNDED, settings)

    first, second = fresh(), fresh()
    first.update(batch(first.policy))
    second.update(batch(second.policy))  # so that storages and optimiser exist
    second.load_state_dict(copy.deepcopy(first.state_dict()))
    data = batch(first.policy)
    losses = []
    for objective in (first, second):
        seed_everything(1)
        losses.append(objective.update(data.clone()))
    assert losses[0] == losses[1]
    for a, b in zip(first.loss.parameters(), second.loss.parameters(), strict=True):
        assert torch.equal(a, b)


def test_sac_says_which_world_gave_no_number_and_remembers_nothing_of_the_batch() -> None:
    learner = sac(OBSERVATION, BOUNDED)
    data = batch(learner.policy)
    data["next", "reward"][3, 5] = torch.nan
    before = copy.deepcopy(learner.buffer.state_dict())
    with pytest.raises(BadInput, match=r"'reward'.*1 of the batch's 8 rows, first in 3"):
        learner.update(data)
    assert str(learner.buffer.state_dict()) == str(before)


@pytest.mark.parametrize("make", [sac, ddpg])
def test_an_action_without_bounds_is_refused(make) -> None:
    with pytest.raises(BadInput, match="finite bounds"):
        make(OBSERVATION, Bounded(torch.tensor([-torch.inf]), torch.tensor([1.0])))
