"""Rejection ABC against an exact posterior, and what it refuses."""

from __future__ import annotations

import pytest
import torch

from onlinebayes.embeddings import LSTMEmbedding, SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import RejectionABC
from onlinebayes.inference.calibration import credibility_of
from onlinebayes.inference.testing import check_estimator
from onlinebayes.runs import BadInput
from tests.inference.systems import STEPS
from tests.inference.test_protocol import PRIOR, SPACE, simulate

SD = 0.2


def made(share: float = 0.05, *, adjusted: bool = False) -> RejectionABC:
    return RejectionABC(SummaryEmbedding(TransitionFeatures(2, 1)), SPACE, share=share, adjusted=adjusted)


@pytest.mark.parametrize("adjusted", [False, True])
def test_it_keeps_the_protocol(adjusted: bool) -> None:
    check_estimator(lambda: made(adjusted=adjusted), simulate, PRIOR)


def test_the_adjusted_posterior_is_the_exact_one() -> None:
    """In the middle of the box the exact posterior is a Gaussian of standard deviation SD / sqrt(STEPS) in z."""
    generator = torch.Generator().manual_seed(0)
    estimator = made(0.1, adjusted=True)
    estimator.fit(simulate(PRIOR.sample((20_000,), generator), generator), generator=generator)
    theta = SPACE.from_unit(torch.full((40, 2), 0.5, dtype=torch.float64))
    measured = simulate(theta, generator)
    change = (measured["next", "observation"] - measured["observation"]).mean(1)
    draws = SPACE.to_unit(estimator.each(measured[:, None]).sample((2000,), generator))
    middle, spread = draws.mean(0), draws.std(0)
    inside = ((change > 0.35) & (change < 0.65)).all(-1)
    assert int(inside.sum()) >= 10
    exact = SD / STEPS**0.5
    assert float((middle - change)[inside].abs().mean()) < 0.2 * exact
    # Silverman's kernel adds a few per cent to a standard deviation.
    assert float(spread[inside].mean()) == pytest.approx(exact, rel=0.12)


def test_its_regions_hold_the_truth_as_often_as_they_say() -> None:
    generator = torch.Generator().manual_seed(1)
    estimator = made(0.02, adjusted=True)
    estimator.fit(simulate(PRIOR.sample((10_000,), generator), generator), generator=generator)
    theta = PRIOR.sample((300,), generator)
    alpha = credibility_of(estimator.each(simulate(theta, generator)[:, None]), theta, generator=generator)
    for level in (0.5, 0.95):
        # Three standard errors of a binomial, and a few per cent for the kernels' width.
        error = 3 * (level * (1 - level) / 300) ** 0.5
        assert -error < float((alpha <= level).double().mean()) - level < error + 0.04


def test_it_refuses_what_it_cannot_use() -> None:
    generator = torch.Generator().manual_seed(0)
    with pytest.raises(BadInput, match="has weights"):
        RejectionABC(LSTMEmbedding(TransitionFeatures(2, 1)), SPACE)
    with pytest.raises(BadInput, match="share 0"):
        made(0.0)
    with pytest.raises(BadInput, match="9 simulations"):
        made().fit(simulate(PRIOR.sample((9,), generator), generator), generator=generator)
    with pytest.raises(BadInput, match="call fit first"):
        made().condition(simulate(PRIOR.sample((1,), generator), generator))


def test_few_simulations_and_many_summaries_make_it_wide_and_not_sure() -> None:
    """Two in a hundred of 400 are fewer than the columns of the regression: it would meet each of them exactly."""
    generator = torch.Generator().manual_seed(2)
    estimator = made(adjusted=True)
    estimator.fit(simulate(PRIOR.sample((400,), generator), generator), generator=generator)
    theta = PRIOR.sample((300,), generator)
    posterior = estimator.each(simulate(theta, generator)[:, None])
    # Three standard errors of 300 are .04; a few per cent for what a straight line leaves.
    assert float((credibility_of(posterior, theta, generator=generator) <= 0.95).double().mean()) > 0.87
    assert float(posterior.log_prob(theta).mean()) > float(PRIOR.log_prob(theta).mean()) + 1
