"""Sets of trajectories read as one: the pooled embedding learns the exact posterior of one to five at once."""

from __future__ import annotations

from functools import partial

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.embeddings import LSTMEmbedding, PooledEmbedding, SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import BoxUniform, MixtureEstimator, NeuralEstimator, NeuralPosteriorLoss, fit
from onlinebayes.runs import BadInput, seed_everything
from tests.inference.systems import STEPS, exact_log_prob, trajectories
from tests.inference.test_distributions import _grid
from tests.inference.test_exact_posteriors import LINEAR, SD, _linear

MOST = 5


def sets(theta: torch.Tensor, generator: torch.Generator) -> TensorDict:
    """MOST trajectories of each theta (G, n, T)."""
    flat = trajectories(theta.repeat_interleave(MOST, 0), _linear, SD, generator)
    flat["theta"] = flat["theta"][:, None].expand(-1, STEPS, -1)
    flat.batch_size = [len(flat), STEPS]
    return flat.unflatten(0, (len(theta), MOST))


def estimator_of(member: SummaryEmbedding | LSTMEmbedding, epochs: int) -> NeuralEstimator:
    embedding = PooledEmbedding(member)
    loss = NeuralPosteriorLoss(embedding, MixtureEstimator(LINEAR, embedding.size, components=4, hidden=64))
    return NeuralEstimator(loss, partial(fit, epochs=epochs, batch_size=200, learning_rate=5e-3))


@pytest.fixture(scope="module")
def estimator() -> NeuralEstimator:
    seed_everything(0)
    generator = torch.Generator().manual_seed(1)
    made = estimator_of(SummaryEmbedding(TransitionFeatures(2, 1, products=False)), 30)
    made.fit(sets(BoxUniform(LINEAR).sample((6000,), generator), generator), generator=generator)
    return made


@pytest.mark.parametrize("n", [1, 3, 5])
def test_the_posterior_of_n_trajectories_is_the_exact_one(estimator: NeuralEstimator, n: int) -> None:
    generator = torch.Generator().manual_seed(2)
    fresh = sets(BoxUniform(LINEAR).sample((50,), generator), generator)[:, :n]
    points, volumes = _grid(LINEAR, 80)
    exact = sum(exact_log_prob(fresh[:, i], points, volumes, LINEAR, _linear, SD) for i in range(n))
    assert isinstance(exact, torch.Tensor)
    exact = exact - torch.logsumexp(exact + volumes.log(), -1, keepdim=True)
    ours = estimator.each(fresh).log_prob(points.unsqueeze(1)).T
    # Mean divergence [nats]; the posterior of one, taken for that of five, is 1.2 nats away.
    assert (exact.exp() * (exact - ours) * volumes).sum(-1).mean() < 0.1


def test_order_and_empty_trajectories_do_not_count(estimator: NeuralEstimator) -> None:
    generator = torch.Generator().manual_seed(3)
    fresh = sets(BoxUniform(LINEAR).sample((4,), generator), generator)
    theta = BoxUniform(LINEAR).sample((10, 1), generator)
    as_it_is = estimator.each(fresh[:, :3]).log_prob(theta)
    # The network is in single precision, and a sum in another order rounds otherwise.
    torch.testing.assert_close(estimator.each(fresh[:, [2, 0, 1]]).log_prob(theta), as_it_is, rtol=1e-4, atol=1e-3)
    masked = fresh.clone()
    masked["mask"] = torch.ones(masked.shape, dtype=torch.bool)
    masked["mask"][:, 3:] = False
    # What is padded is not read, whatever stands there.
    masked["observation"][:, 3:] = float("nan")
    torch.testing.assert_close(estimator.each(masked).log_prob(theta), as_it_is, rtol=1e-4, atol=1e-3)
    masked["mask"][2] = False
    with pytest.raises(BadInput, match="no trajectory of set 2 has a recorded step"):
        estimator.each(masked)


def test_the_member_is_trained_with_the_rest() -> None:
    generator = torch.Generator().manual_seed(4)
    made = estimator_of(LSTMEmbedding(TransitionFeatures(2, 1, products=False), hidden=8), 2)
    before = [weight.clone() for weight in made.loss.embedding.parameters()]
    made.fit(sets(BoxUniform(LINEAR).sample((100,), generator), generator), generator=generator)
    assert all(not torch.equal(a, b) for a, b in zip(before, made.loss.embedding.parameters(), strict=True))


def test_whole_sets_are_read_whole() -> None:
    generator = torch.Generator().manual_seed(5)
    embedding = PooledEmbedding(SummaryEmbedding(TransitionFeatures(2, 1, products=False)))
    network = MixtureEstimator(LINEAR, embedding.size)
    data = sets(BoxUniform(LINEAR).sample((7,), generator), generator)
    for whole, expected in ((False, [1, 2, 3, 4, 5, 1, 2]), (True, [5] * 7)):
        prepared = NeuralPosteriorLoss(embedding, network, whole_sets=whole).prepare(data)
        assert prepared["embedding"][:, -1].exp().round().tolist() == expected


def test_tails_are_what_the_last_trajectories_say(estimator: NeuralEstimator) -> None:
    generator = torch.Generator().manual_seed(4)
    fresh = sets(BoxUniform(LINEAR).sample((1,), generator), generator)[0]
    theta = BoxUniform(LINEAR).sample((10,), generator)
    for begin, tail in zip((0, 3), estimator.tails(fresh, (0, 3)), strict=True):
        assert torch.allclose(tail.log_prob(theta), estimator.condition(fresh[begin:]).log_prob(theta), atol=1e-4)
