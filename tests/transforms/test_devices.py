"""Transforms over worlds on a GPU: they conform there, and a seed decides their draws."""

from __future__ import annotations

import pytest
import torch
from torchrl.collectors import Collector
from torchrl.envs import TransformedEnv

from envs.cartpole import CartPole, CartPoleTask
from onlinebayes.embeddings import LSTMEmbedding, TransitionFeatures
from onlinebayes.inference import Box, BoxUniform, TruncatedMixture
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.transforms import ParameterRandomization, SensorNoise, TrajectoryEmbedding
from onlinebayes.transforms.testing import check_transform

pytestmark = pytest.mark.gpu

DEVICE = "cuda"
SPACE = ParameterSpace({"length": Parameter(0.1, 1.0, "m"), "mass": Parameter(0.1, 1.0, "kg")})
SD = torch.tensor([0.1, 0.0, 0.01, 1.0])


def make_env() -> SimulatorEnv:
    return SimulatorEnv(CartPole(SPACE, 8, device=DEVICE), CartPoleTask())


def narrow() -> TruncatedMixture:
    """A belief that lies on the GPU, and draws there unless it is given a generator."""
    values = torch.zeros(1), torch.full((1, 2), 0.5), 0.1 * torch.eye(2)[None]
    return TruncatedMixture(*(value.to(DEVICE).double() for value in values), Box.whole(SPACE))


MADE = {
    "noise": lambda: SensorNoise(SD),
    "noise made there": lambda: SensorNoise(SD.to(DEVICE)),
    "embedding": lambda: TrajectoryEmbedding(LSTMEmbedding(TransitionFeatures(4, 2), hidden=8).to(DEVICE)),
    "prior": lambda: ParameterRandomization(BoxUniform(SPACE)),
    "belief": lambda: ParameterRandomization(narrow()),
}


@pytest.mark.parametrize("kind", MADE)
def test_it_conforms(kind: str) -> None:
    check_transform(make_env, MADE[kind])


def test_an_embedding_made_on_the_cpu_follows_its_environment() -> None:
    made = TrajectoryEmbedding(LSTMEmbedding(TransitionFeatures(4, 2), hidden=8))
    data = TransformedEnv(make_env(), made).rollout(20, break_when_any_done=False)
    assert data["next", "embedding", "vector"].device.type == DEVICE


@pytest.mark.parametrize("kind", ["prior", "belief"])
def test_a_seed_decides_the_draws(kind: str) -> None:
    def thetas(seed: int) -> torch.Tensor:
        env = TransformedEnv(make_env(), MADE[kind]())
        env.set_seed(seed)
        return torch.stack([env.reset()["theta"] for _ in range(3)])

    torch.manual_seed(7)
    one, other, again = thetas(1), thetas(2), thetas(1)
    assert torch.equal(one, again)
    assert not torch.equal(one, other)
    assert not torch.equal(one[0], one[1])


def test_draws_leave_the_other_random_numbers_alone_and_go_on_from_a_checkpoint() -> None:
    made = MADE["belief"]()
    env = TransformedEnv(make_env(), made)
    env.set_seed(3)
    env.reset()
    torch.manual_seed(0)
    expected = torch.rand(3, device=DEVICE)
    torch.manual_seed(0)
    saved = made.get_extra_state()
    first = env.reset()["theta"]
    assert torch.equal(torch.rand(3, device=DEVICE), expected)
    made.set_extra_state(saved)
    assert torch.equal(env.reset()["theta"], first)


def test_all_of_them_through_a_collector() -> None:
    env = TransformedEnv(make_env(), ParameterRandomization(narrow()))
    for kind in ("noise", "embedding"):
        env.append_transform(MADE[kind]())
    collector = Collector(env, frames_per_batch=8 * 60, total_frames=8 * 120, track_traj_ids=False)
    for batch in collector:
        assert {value.device.type for value in batch.values(True, True)} == {DEVICE}
        assert batch["theta"].isfinite().all()
        assert (batch["next", "done"][:, :-1, 0] == (batch["theta"][:, 1:] != batch["theta"][:, :-1]).any(-1)).all()
