"""Step by step equals the whole sequence; the hidden state belongs to the episode and the copy is frozen."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDictBase
from torchrl.envs import Compose, InitTracker, SerialEnv, TransformedEnv

from onlinebayes.embeddings import LSTMEmbedding, TransitionFeatures
from onlinebayes.transforms import ParameterRandomization, TrajectoryEmbedding
from onlinebayes.transforms.testing import check_parallel, check_transform
from tests.transforms.systems import Uniform, make_env

KEYS = [("embedding", "vector"), ("embedding", "hidden")]


def test_conforms() -> None:
    check_transform(make_env, _transform, lambda: make_env().rollout(7, break_when_any_done=False))


@pytest.mark.slow
def test_conforms_in_processes() -> None:
    check_parallel(make_env, _transform)


def test_step_by_step_equals_the_whole_sequence_of_every_ragged_episode() -> None:
    embedding = _embedding()
    env = TransformedEnv(make_env(worlds=4), TrajectoryEmbedding(embedding))
    data = env.rollout(60, break_when_any_done=False)
    episodes = 0
    for world in data.unbind(0):
        ends = world["next", "done"][:, 0].nonzero()[:, 0].tolist()
        for first, last in zip([0, *(e + 1 for e in ends)], [*ends, len(world) - 1], strict=True):
            if first > last:
                continue
            episode = world[first : last + 1][None]
            whole = embedding(episode["observation"], episode["action"].float(), episode["next", "observation"])
            torch.testing.assert_close(episode["next", "embedding", "vector"][:, -1], whole, rtol=1e-5, atol=1e-6)
            assert not episode["embedding", "hidden"][:, 0].any()
            assert not episode["embedding", "vector"][:, 0].any()
            episodes += 1
    assert episodes > 6


def test_recorded_trajectories_give_what_the_environment_gave() -> None:
    embedding = _embedding()
    env = TransformedEnv(make_env(worlds=4), Compose(InitTracker(), TrajectoryEmbedding(embedding)))
    data = env.rollout(60, break_when_any_done=False)
    again = TrajectoryEmbedding(embedding)(data.exclude("embedding", ("next", "embedding")))
    for key in KEYS:
        torch.testing.assert_close(again[key], data[key], rtol=1e-5, atol=1e-6)
        torch.testing.assert_close(again["next", *key], data["next", *key], rtol=1e-5, atol=1e-6)
    # A slice from the middle of an episode goes on from the hidden row recorded with its first step.
    middle = TrajectoryEmbedding(embedding)(data[:, 5:20].clone())
    torch.testing.assert_close(middle["next", *KEYS[0]], data[:, 5:20]["next", *KEYS[0]], rtol=1e-5, atol=1e-6)


def test_padding_changes_nothing() -> None:
    embedding = _embedding()
    data = make_env(worlds=4).rollout(9, break_when_any_done=False)
    length = torch.tensor([9, 4, 1, 6])
    data["mask"] = torch.arange(9)[None] < length[:, None]
    data["next", "observation"][~data["mask"]] = torch.nan
    out = TrajectoryEmbedding(embedding)(data)["next", "embedding", "vector"]
    whole = embedding(data["observation"], data["action"].float(), data["next", "observation"], data["mask"])
    torch.testing.assert_close(out[:, -1], whole, rtol=1e-5, atol=1e-6)
    assert out.isfinite().all()


def test_is_init_clears_the_state() -> None:
    transform = _transform()
    data = make_env(worlds=2).rollout(6, break_when_any_done=False)
    data["is_init"] = torch.zeros(2, 6, 1, dtype=torch.bool)
    data["is_init"][:, 3] = True
    out = transform(data.clone())
    tail = transform(data[:, 3:].clone())
    for key in KEYS:
        torch.testing.assert_close(out[key][:, 3:], tail[key])


def test_the_copy_is_frozen_until_it_is_replaced() -> None:
    embedding = _embedding()
    transform = TrajectoryEmbedding(embedding)
    data = make_env().rollout(5)
    before = _last(transform, data)
    with torch.no_grad():
        for parameter in embedding.parameters():
            parameter.mul_(2.0)
    assert torch.equal(_last(transform, data), before)
    assert not any(parameter.requires_grad for parameter in transform.parameters())
    assert all(parameter.requires_grad for parameter in embedding.parameters())
    transform.set_embedding(embedding)
    assert not torch.allclose(_last(transform, data), before)


def test_beside_randomisation_and_over_several_environments() -> None:
    env = TransformedEnv(
        SerialEnv(2, make_env), Compose(ParameterRandomization(Uniform()), TrajectoryEmbedding(_embedding()))
    )
    data = env.rollout(60, break_when_any_done=False)
    first = torch.cat((torch.ones(2, 3, 1, dtype=torch.bool), data["next", "done"][:, :, :-1, 0]), dim=-1)
    assert torch.equal(data["embedding", "hidden"].any(-1), ~first)


def _embedding() -> LSTMEmbedding:
    torch.manual_seed(3)
    return LSTMEmbedding(TransitionFeatures(4, 2), hidden=8)


def _transform() -> TrajectoryEmbedding:
    return TrajectoryEmbedding(_embedding())


def _last(transform: TrajectoryEmbedding, data: TensorDictBase) -> torch.Tensor:
    return transform(data.clone())["next", "embedding", "vector"][:, -1].clone()
