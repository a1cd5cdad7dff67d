"""A posterior that is asked about trajectories of another length than it was learnt from says so, once."""

from __future__ import annotations

import copy
from functools import partial

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.embeddings import PooledEmbedding, SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import (
    MixtureEstimator,
    NeuralEstimator,
    NeuralPosteriorLoss,
    Posterior,
    RejectionABC,
    fit,
    lengths,
)
from tests.inference import test_filtered
from tests.inference.test_protocol import PRIOR, SPACE

LONGEST = 50


def simulate(steps: torch.Tensor, seed: int = 0) -> TensorDict:
    """Observations that drift by u and are noisy, one trajectory for each number of steps."""
    random, rows = torch.Generator().manual_seed(seed), len(steps)
    theta = PRIOR.sample((rows,), random)
    change = SPACE.to_unit(theta)[:, None] + 0.5 * torch.randn(rows, LONGEST, 2, generator=random).double()
    seen = torch.cat([torch.zeros(rows, 1, 2).double(), change.cumsum(1)], 1)
    told = {"observation": seen[:, :-1], "action": torch.zeros(rows, LONGEST, 1), "next": {"observation": seen[:, 1:]}}
    mask = torch.arange(LONGEST) < steps[:, None]
    return TensorDict({**told, "mask": mask, "theta": theta[:, None].expand(-1, LONGEST, -1)}, [rows, LONGEST])


def neural() -> NeuralEstimator:
    embedding = SummaryEmbedding(TransitionFeatures(2, 1, products=False))
    loss = NeuralPosteriorLoss(embedding, MixtureEstimator(SPACE, embedding.size, hidden=16))
    return NeuralEstimator(loss, partial(fit, epochs=3))


def rejecting() -> RejectionABC:
    return RejectionABC(SummaryEmbedding(TransitionFeatures(2, 1, products=False)), SPACE)


@pytest.fixture(autouse=True)
def _nothing_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lengths, "_SAID", set())


@pytest.fixture
def learnt_from() -> TensorDict:
    return simulate(20 + torch.arange(200) % 31)


@pytest.mark.parametrize("make", [neural, rejecting])
def test_much_shorter_and_much_longer_trajectories_are_told(make, learnt_from, caplog) -> None:
    estimator = make()
    estimator.fit(learnt_from[:, :40], generator=torch.Generator().manual_seed(0))
    for steps in (16, 20, 40, 50):
        estimator.condition(simulate(torch.tensor([steps])))
    assert caplog.messages == []
    for steps in (5, 5, 6):
        estimator.condition(simulate(torch.tensor([steps])))
    (line,) = caplog.messages
    assert line == (
        "a posterior learnt from trajectories of 20 to 40 steps is asked about 5: its widths may be far too narrow;"
        " simulate trajectories of that length"
    )
    estimator.fit(learnt_from[:, :10], generator=torch.Generator().manual_seed(0))
    estimator.condition(simulate(torch.tensor([30])))
    assert "10 steps is asked about 30: its widths may be far too wide" in caplog.messages[-1]


def test_trajectories_of_sets_are_told_too(caplog) -> None:
    """One density a set, by an embedding that reads sets."""
    torch.manual_seed(0)
    embedding = PooledEmbedding(SummaryEmbedding(TransitionFeatures(2, 1, products=False)))
    loss = NeuralPosteriorLoss(embedding, MixtureEstimator(SPACE, embedding.size, hidden=16))
    fit(
        loss,
        simulate(torch.full((120,), 20)).unflatten(0, (40, 3)),
        generator=torch.Generator().manual_seed(0),
        epochs=2,
    )
    known, short = (simulate(torch.full((6,), steps)).unflatten(0, (2, 3)) for steps in (20, 5))
    assert Posterior(loss).each(known).batch_shape == (2,)
    assert caplog.messages == []
    assert Posterior(loss).each(short).batch_shape == (2,)
    assert "20 steps is asked about 5: its widths may be far too narrow" in caplog.messages[-1]


def test_it_is_true(learnt_from) -> None:
    """After 5 steps the exact standard deviation is twice that after 20; the one that is told is much the same."""
    estimator = neural()
    estimator.fit(learnt_from, generator=torch.Generator().manual_seed(0))
    spread = [float(estimator.condition(simulate(torch.tensor([n]), 3)).sample((2000,)).std(0).mean()) for n in (5, 20)]
    assert spread[0] < 1.5 * spread[1]


def test_a_loaded_estimator_says_it_too(learnt_from, caplog) -> None:
    estimator, other = neural(), neural()
    estimator.fit(learnt_from, generator=torch.Generator().manual_seed(0))
    other.loss.load_state_dict(copy.deepcopy(estimator.loss.state_dict()))
    other.condition(simulate(torch.tensor([5])))
    assert len(caplog.messages) == 1


def test_a_filter_whose_widths_follow_the_length_says_nothing(caplog) -> None:
    data = test_filtered.simulate(test_filtered.PRIOR.sample((20,)), torch.Generator().manual_seed(0))
    estimator = test_filtered.made()
    estimator.fit(data, generator=torch.Generator().manual_seed(0))
    widths = [estimator.condition(data[:1, :n].exclude("theta")).sample((500,)).std(0).mean() for n in (5, 30)]
    assert caplog.messages == []
    assert widths[0] > 1.5 * widths[1]
