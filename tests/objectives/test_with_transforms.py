"""Objectives read what transforms of an environment write: TorchRL's, and an embedding of the episode so far."""

from __future__ import annotations

import pytest
import torch
from torchrl.collectors import Collector
from torchrl.envs import CatTensors, InitTracker, StepCounter, TransformedEnv

from onlinebayes.embeddings import LSTMEmbedding, TransitionFeatures
from onlinebayes.objectives import ActorCriticSettings, PPOSettings, SACSettings, actor_critic, ppo, sac
from onlinebayes.runs import BadInput
from onlinebayes.transforms import TrajectoryEmbedding
from tests.objectives.test_examples_ddpg import Points


def joined() -> CatTensors:
    return CatTensors(["observation", "desired_goal"], "row", del_keys=False)


def embedded() -> TrajectoryEmbedding:
    return TrajectoryEmbedding(LSTMEmbedding(TransitionFeatures(2, 2), hidden=4))


def batch(env, policy):
    collector = Collector(env, policy, frames_per_batch=160, total_frames=160, auto_register_policy_transforms=False)
    data = next(iter(collector))
    collector.shutdown()
    return data


@pytest.mark.parametrize(
    ("build", "settings"),
    [
        (ppo, PPOSettings(minibatch=80, normalise=True)),
        (sac, SACSettings(minibatch=80, normalise=True)),
        (actor_critic, ActorCriticSettings(normalise=True)),
    ],
)
@pytest.mark.parametrize(
    ("transform", "keys"),
    [
        (joined, ["row"]),
        (embedded, ["observation", ("embedding", "vector")]),
        (embedded, [("embedding", "vector"), "observation", "desired_goal"]),
    ],
)
def test_in_keys_name_what_a_transform_writes(build, settings, transform, keys):
    env = TransformedEnv(Points(), StepCounter(max_steps=7))
    env.append_transform(InitTracker())
    env.append_transform(transform())
    objective = build(env.observation_spec_unbatched, env.action_spec_unbatched, settings, in_keys=keys)
    if build is actor_critic:
        env.append_transform(objective.network.make_tensordict_primer())
    data = batch(env, objective.policy)
    assert all(torch.isfinite(torch.tensor(value)) for value in objective.update(data).values())
    assert objective.inputs.width == sum(data[key].shape[-1] for key in keys)


def test_data_of_an_environment_without_the_transform_are_refused():
    env = TransformedEnv(Points(), StepCounter(max_steps=7))
    plain = ppo(env.observation_spec_unbatched, env.action_spec_unbatched)
    data = batch(env, plain.policy)
    env.append_transform(joined())
    objective = ppo(env.observation_spec_unbatched, env.action_spec_unbatched, in_keys=["row"])
    with pytest.raises(BadInput, match="the batch has no 'row'"):
        objective.update(data)
