"""Population Monte-Carlo ABC against an exact posterior and against rejection at the same budget."""

from __future__ import annotations

import pytest
import torch

from onlinebayes.embeddings import LSTMEmbedding, SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import BoxUniform, PopulationABC, RejectionABC
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from tests.inference.systems import STEPS
from tests.inference.test_protocol import PRIOR, SPACE, simulate

SD = 0.02
TRUTH = SPACE.from_unit(torch.tensor([[0.4, 0.6]], dtype=torch.float64))


def sharp(theta: torch.Tensor, generator: torch.Generator):
    return simulate(theta, generator, SD)


class Change(SummaryEmbedding):
    """The mean change of the observation: all that these trajectories say of theta."""

    def __init__(self) -> None:
        super().__init__(TransitionFeatures(2, 1))

    def fit(self, observation, action, following, mask) -> None:
        pass

    def forward(self, observation, action, following, mask=None) -> torch.Tensor:
        return (following - observation).mean(1)


def sampler(**more) -> PopulationABC:
    return PopulationABC(Change(), PRIOR, sharp, **more)


def test_it_closes_in_on_the_exact_posterior_where_rejection_is_wide() -> None:
    """The exact posterior is a Gaussian of standard deviation SD / sqrt(STEPS) in z: a hundredth of the box."""
    generator = torch.Generator().manual_seed(0)
    measured = sharp(TRUTH, generator)
    change = (measured["next", "observation"] - measured["observation"]).mean(1)[0]
    found = sampler(simulations=15_000).run(measured, generator)
    draws = SPACE.to_unit(found.belief.sample((4000,), generator))
    exact = SD / STEPS**0.5
    assert list(found.tolerances) == sorted(found.tolerances, reverse=True)
    assert found.simulations <= 15_000
    assert found.effective > 50
    assert float((draws.mean(0) - change).abs().max()) < exact
    assert float(draws.std(0).mean()) < 3 * exact
    wide = RejectionABC(Change(), SPACE, share=200 / found.simulations)
    wide.fit(sharp(PRIOR.sample((found.simulations,), generator), generator), generator=generator)
    rejected = SPACE.to_unit(wide.condition(measured).sample((4000,), generator))
    assert float(draws.std(0).mean()) < 0.6 * float(rejected.std(0).mean())


def test_weights_undo_what_the_proposals_prefer() -> None:
    """Where summaries say nothing the posterior is the prior, however often the cloud was moved."""
    space = ParameterSpace({"a": Parameter(0.0, 1.0)})
    prior = BoxUniform(space)

    def deaf(theta: torch.Tensor, generator: torch.Generator):
        return simulate(torch.full_like(theta.expand(-1, 2), 0.5), generator, 1.0)

    generator = torch.Generator().manual_seed(0)
    made = PopulationABC(
        SummaryEmbedding(TransitionFeatures(2, 1)),
        prior,
        deaf,
        particles=1000,
        batch=2000,
        simulations=30_000,
        quantile=0.8,
    )
    found = made.run(deaf(torch.full((1, 1), 0.5).double(), generator), generator)
    assert len(found.tolerances) > 3
    draws = found.belief.sample((5000,), generator)[:, 0]
    # A thousand particles: standard errors of .009 and .003; the kernels' edges cost a little more.
    assert float(draws.mean()) == pytest.approx(0.5, abs=0.04)
    assert float(draws.var()) == pytest.approx(1 / 12, abs=0.015)


def test_a_seed_repeats_a_run() -> None:
    measured = sharp(TRUTH, torch.Generator().manual_seed(1))
    first, second = (
        sampler(simulations=4000).run(measured, torch.Generator().manual_seed(2)).belief.mean for _ in range(2)
    )
    assert torch.equal(first, second)


def test_it_refuses_what_it_cannot_use() -> None:
    with pytest.raises(BadInput, match="has weights"):
        PopulationABC(LSTMEmbedding(TransitionFeatures(2, 1)), PRIOR, sharp)
    for wrong in ({"quantile": 1.0}, {"particles": 2000}, {"simulations": 10}):
        with pytest.raises(BadInput, match="needs 0 < quantile < 1"):
            sampler(**wrong)
