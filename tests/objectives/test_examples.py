"""PPO, SAC and the recurrent actor-critic piece by piece in a plain TorchRL loop, on environments of anybody's."""

from __future__ import annotations

import gymnasium
import pytest
import torch
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from torch.nn.utils import clip_grad_norm_
from torchrl.collectors import Collector
from torchrl.envs import EnvBase, GymWrapper, TransformedEnv
from torchrl.envs.utils import ExplorationType, set_exploration_type

from onlinebayes.objectives import ActorCriticSettings, PPOSettings, SACSettings, actor_critic, ppo, sac
from tests.objectives.test_actor_critic import Recall

pytestmark = pytest.mark.usefixtures("without_shape_checks")


def gym(name: str, n: int, **settings) -> EnvBase:
    """``n`` Gymnasium environments as one; TorchRL resets those that are done."""
    worlds = [lambda: gymnasium.make(name, **settings) for _ in range(n)]
    return GymWrapper(SyncVectorEnv(worlds, autoreset_mode=AutoresetMode.DISABLED))


def batches(env: EnvBase, policy, steps: int, number: int) -> Collector:
    frames = steps * env.batch_size.numel()
    return Collector(
        env, policy, frames_per_batch=frames, total_frames=number * frames, auto_register_policy_transforms=False
    )


def mean_return(env: EnvBase, policy, steps: int) -> float:
    """Of the first episode of each world, acting without chance."""
    with set_exploration_type(ExplorationType.DETERMINISTIC), torch.no_grad():
        told = env.rollout(steps, policy, break_when_any_done=False)["next"]
    first = told["done"].cumsum(1) - told["done"].long() == 0
    return float((told["reward"] * first).sum(1).mean())


def test_ppo_in_a_loop_of_ones_own():
    env = gym("CartPole-v1", 16)
    objective = ppo(env.observation_spec_unbatched, env.action_spec_unbatched, PPOSettings(minibatch=256))
    policy, loss, optimiser = objective.policy, objective.loss, objective.optimiser
    for data in batches(env, policy, 64, 12):
        data["next", "reward"] *= 1 - objective.settings.gamma
        with torch.no_grad():
            objective.advantage(data)
        objective.buffer.empty()
        objective.buffer.extend(data.reshape(-1))
        for _ in range(4):
            for minibatch in objective.buffer:
                losses = loss(minibatch)
                (losses["loss_objective"] + losses["loss_critic"] + losses["loss_entropy"]).backward()
                clip_grad_norm_(policy.parameters(), 0.5)
                optimiser.step()
                optimiser.zero_grad()
    assert mean_return(env, policy, 150) > 100  # a random policy: 22


@pytest.mark.slow
def test_sac_in_a_loop_of_ones_own():
    env = gym("Pendulum-v1", 8)
    settings = SACSettings(gamma=0.98, tau=0.02, alpha=0.3, learning_rate=2e-3)
    objective = sac(env.observation_spec_unbatched, env.action_spec_unbatched, settings)
    loss, buffer, optimiser = objective.loss, objective.buffer, objective.optimiser
    for data in batches(env, objective.policy, 25, 40):
        fresh = data.select(*loss.in_keys).reshape(-1)
        fresh["next", "reward"] *= 0.1
        buffer.extend(fresh)
        for _ in range(25):
            losses = loss(buffer.sample(64))
            (losses["loss_actor"] + losses["loss_qvalue"] + losses["loss_alpha"]).backward()
            optimiser.step()
            optimiser.zero_grad()
            objective.target.step()
    assert mean_return(env, objective.policy, 200) > -500  # a random policy: -1200


def test_a_recurrent_actor_critic_in_a_loop_of_ones_own():
    # A cue is shown at the first step only; the action that repeats it two steps later is worth 1.
    env = TransformedEnv(Recall(delay=2))
    settings = ActorCriticSettings(width=32, gamma=0.9, learning_rate=3e-3)
    objective = actor_critic(env.observation_spec_unbatched, env.action_spec_unbatched, settings)
    for transform in objective.transforms():
        env.append_transform(transform)
    for data in batches(env, objective.policy, 6, 60):
        losses = objective.losses(data)
        (losses["loss_policy"] + 0.5 * losses["loss_value"] + 0.01 * losses["loss_entropy"]).backward()
        clip_grad_norm_(objective.network.parameters(), 0.5)
        objective.optimiser.step()
        objective.optimiser.zero_grad()
    assert mean_return(env, objective.policy, 3) > 0.95  # without memory: 0.5
