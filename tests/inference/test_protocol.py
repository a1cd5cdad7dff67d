"""The estimator protocol, kept by the library's own estimator and by one that shares nothing with it."""

from __future__ import annotations

import math
from functools import partial

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.embeddings import SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import (
    Box,
    BoxUniform,
    FitReport,
    Gate,
    MixtureEstimator,
    NeuralEstimator,
    NeuralPosteriorLoss,
    Posterior,
    TruncatedMixture,
    fit,
    proposals,
)
from onlinebayes.inference.calibration import credibility_of
from onlinebayes.inference.distributions.marginal import Marginal
from onlinebayes.inference.saving import from_state, to_state
from onlinebayes.inference.testing import check_estimator
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.runs.checkpoints import plain
from tests.inference.systems import trajectories

SPACE = ParameterSpace({"a": Parameter(-1.0, 1.0, "m"), "b": Parameter(0.0, 3.0, "kg")})
PRIOR = BoxUniform(SPACE)


def simulate(theta: torch.Tensor, generator: torch.Generator, sd: float = 0.2) -> TensorDict:
    data = trajectories(theta, SPACE.to_unit, sd, generator)
    steps = data["observation"].shape[1]
    data["theta"] = theta[:, None].expand(-1, steps, -1).clone()
    data.batch_size = [len(theta), steps]
    return data


def neural(epochs: int = 15) -> NeuralEstimator:
    embedding = SummaryEmbedding(TransitionFeatures(2, 1))
    loss = NeuralPosteriorLoss(embedding, MixtureEstimator(SPACE, embedding.size, components=2, hidden=32))
    return NeuralEstimator(loss, partial(fit, epochs=epochs, learning_rate=5e-3))


class Regression:
    """A Gaussian about a linear regression of theta on the mean change: no network, no mixture of ours to train."""

    def __init__(self) -> None:
        self.space, self.box = SPACE, Box.whole(SPACE)

    @staticmethod
    def rows(data: TensorDict) -> torch.Tensor:
        change = (data["next", "observation"] - data["observation"]).mean(-2)
        return torch.cat([change, torch.ones_like(change[..., :1])], -1)

    def fit(self, simulations, groups=None, *, generator) -> FitReport:
        rows, z = self.rows(simulations), self.box.to_frame(simulations["theta"][:, 0])
        self.weights = torch.linalg.lstsq(rows, z).solution
        self.scale = (z - rows @ self.weights).std(0)
        return FitReport(train=[0.0])

    def each(self, groups: TensorDict) -> TruncatedMixture:
        mean = (self.rows(groups) @ self.weights).mean(1).unsqueeze(-2)
        lower = torch.diag(self.scale / math.sqrt(groups.shape[1])).expand(len(mean), 1, 2, 2)
        return TruncatedMixture(torch.zeros(len(mean), 1).double(), mean, lower, self.box)

    def condition(self, trajectories: TensorDict) -> TruncatedMixture:
        return self.each(trajectories[None])[0]


@pytest.mark.parametrize("make", [neural, Regression])
def test_an_estimator_keeps_the_protocol(make) -> None:
    check_estimator(make, simulate, PRIOR)


def test_a_broken_estimator_is_caught() -> None:
    class Deaf(Regression):
        def each(self, groups):
            mean = torch.full((len(groups), 1, 2), 0.5).double()
            return TruncatedMixture(
                torch.zeros(len(groups), 1).double(), mean, torch.eye(2).double().expand(len(groups), 1, 2, 2), self.box
            )

    with pytest.raises(AssertionError, match="nats over the prior"):
        check_estimator(Deaf, simulate, PRIOR)

    class Wide(TruncatedMixture):
        """Tells a density of other draws: those of half the width."""

        def sample_frame(self, shape=(), generator=None):
            z = super().sample_frame(shape, generator)
            return self.mean[..., 0, :] + 0.5 * (z - self.mean[..., 0, :])

    class Misled(Regression):
        def condition(self, trajectories):
            found = super().condition(trajectories)
            return Wide(found.log_weights, found.mean, found.scale_tril, found.box)

    with pytest.raises(AssertionError, match="of its draws lie"):
        check_estimator(Misled, simulate, PRIOR)


def test_a_product_is_widened_until_it_holds_the_truths() -> None:
    """Four trajectories that share one error look like four independent ones to a plain product."""
    generator = torch.Generator().manual_seed(0)

    def shared(theta: torch.Tensor, copies: int) -> torch.Tensor:
        return torch.stack([simulate(theta, generator)] * copies, dim=1)  # the same trajectory n times

    estimator, held = neural(), PRIOR.sample((200,), generator)
    estimator.fit(simulate(PRIOR.sample((600,), generator), generator), shared(held, 4), generator=generator)
    assert estimator.combination > 1.5, "sqrt 4 would be exact"
    fresh = PRIOR.sample((400,), generator)
    alpha = credibility_of(estimator.each(shared(fresh, 4)), fresh, generator=generator)
    # 380 of 400 expected; three standard errors of a binomial are 13.
    assert (alpha <= 0.95).double().mean() > 0.91


def belief(mean: float, sd: float) -> TruncatedMixture:
    return TruncatedMixture(
        torch.zeros(1).double(),
        torch.full((1, 2), mean).double(),
        (sd * torch.eye(2)).double()[None],
        Box.whole(SPACE),
    )


def test_the_gate_narrows_only_on_a_belief_that_holds_the_truths() -> None:
    generator = torch.Generator().manual_seed(0)
    good, bad = torch.linspace(0, 1, 64), torch.linspace(0.5, 1.3, 64)
    first = Gate().decide(belief(0.5, 0.05), PRIOR, good, generator=generator)
    assert first.narrowed
    assert "narrowed to" in first.reason
    assert first.proposal.log_volume < -1
    second = Gate().decide(belief(0.5, 0.001), first.proposal, bad, generator=generator)
    assert not second.narrowed
    assert "widened to" in second.reason
    assert second.coverage == pytest.approx(float((bad <= 0.95).double().mean()))
    inside = first.proposal.sample((500,), generator)
    assert second.proposal.contains(inside).all(), "what is wider holds all of what it was made from"
    assert second.proposal.log_volume > first.proposal.log_volume


def test_a_proposal_is_made_of_any_belief() -> None:
    class Draws:
        space, box = SPACE, Box.whole(SPACE)

        def sample(self, shape=(), generator=None):
            z = 0.4 + 0.2 * torch.rand(*shape, 2).double()
            stray = torch.rand(*shape, 1) < 0.005
            return self.box.from_frame(torch.where(stray, torch.rand(*shape, 2).double(), z))

        def log_prob(self, theta):
            return torch.where(((self.box.to_frame(theta) - 0.5).abs() < 0.1).all(-1), 0.0, -8.0)

    proposal = proposals.truncated(Draws(), generator=torch.Generator().manual_seed(0))
    corners = torch.tensor([[0.41, 0.41], [0.59, 0.59]]).double()
    assert proposal.contains(Draws.box.from_frame(corners)).all()
    assert -3.5 < proposal.box.log_volume < -2


def test_distributions_are_the_same_after_saving() -> None:
    generator = torch.Generator().manual_seed(0)
    first = proposals.truncated(belief(0.4, 0.05), PRIOR, generator=generator)
    second = proposals.truncated(belief(0.45, 0.03), first, generator=generator)
    small = BoxUniform(SPACE, Box(SPACE, torch.tensor([0.1, 0.2]).double(), torch.tensor([0.5, 0.6]).double()))
    for each in (PRIOR, small, belief(0.4, 0.1), first, second):
        again = from_state(SPACE, plain(to_state(each)))
        draws = [x.sample((50,), torch.Generator().manual_seed(1)) for x in (each, again)]
        assert torch.equal(*draws)
        assert torch.equal(each.log_prob(draws[0]), again.log_prob(draws[0]))
    with pytest.raises(BadInput, match="has 2 parameters, the space 1"):
        from_state(SPACE.subspace(["a"]), to_state(PRIOR))
    with pytest.raises(BadInput, match="of kind 'diffusion'"):
        from_state(SPACE, {"kind": "diffusion"})
    with pytest.raises(BadInput, match="Marginal cannot be saved"):
        to_state(Marginal(PRIOR, ["a"]))


@pytest.mark.parametrize(("value", "why"), [(math.nan, "is not finite"), (40.0, "lies outside the estimator's box")])
def test_theta_that_the_box_does_not_hold_is_refused(value: float, why: str) -> None:
    generator = torch.Generator().manual_seed(0)
    data = simulate(PRIOR.sample((20,), generator), generator)
    data["theta"][3, :, 0] = value
    estimator = neural(1)
    with pytest.raises(BadInput, match=rf"of trajectory 3 \(1 such\) {why}"):
        estimator.fit(data, generator=generator)
    assert isinstance(Posterior(estimator.loss).distribution, BoxUniform)
