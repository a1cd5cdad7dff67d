"""Coverage and ranks of posteriors that are right, too narrow and too broad."""

from __future__ import annotations

import torch
from scipy.stats import kstest
from tensordict import TensorDict, TensorDictBase

from onlinebayes.inference import Box, TruncatedMixture, calibration
from tests.inference.test_distributions import ONE

ROWS = 400


def _pairs() -> tuple[torch.Tensor, TensorDict]:
    """z ~ N(x, .05^2) with x in the middle of the box: the posterior of a flat prior."""
    x = 0.3 + 0.4 * torch.rand(ROWS, 1, dtype=torch.float64)
    z = x + 0.05 * torch.randn(ROWS, 1, dtype=torch.float64)
    return ONE.from_unit(z), TensorDict({"x": x}, batch_size=[ROWS])


def _posterior_for(scale: float) -> calibration.PosteriorFor:
    def of(data: TensorDictBase) -> TruncatedMixture:
        rows = data.batch_size[0]
        lower = torch.full((rows, 1, 1, 1), scale, dtype=torch.float64)
        return TruncatedMixture(torch.zeros(rows, 1).double(), data["x"].unsqueeze(1), lower, Box.whole(ONE))

    return of


def test_coverage_of_the_right_the_narrow_and_the_broad() -> None:
    theta, data = _pairs()
    level = torch.tensor(calibration.LEVELS).double()
    # The mean of ten correlated levels, each with a standard error of at most .025; three of them are .075.
    assert (calibration.coverage(_posterior_for(0.05), theta, data) - level).abs().mean() < 0.04
    narrow, broad = (calibration.coverage(_posterior_for(scale), theta, data) for scale in (0.025, 0.1))
    assert (narrow - level).mean() < -0.1
    assert (broad - level).mean() > 0.1


def test_coverage_grows_with_the_level_and_credibility_lies_in_the_unit_interval() -> None:
    theta, data = _pairs()
    covered = calibration.coverage(_posterior_for(0.05), theta, data, (0.1, 0.5, 0.9))
    assert covered.shape == (3,)
    assert (covered.diff() > 0).all()
    alpha = calibration.credibility(_posterior_for(0.05), theta, data, samples=50)
    assert ((alpha >= 0) & (alpha <= 1)).all()


def test_ranks_are_uniform_when_calibrated() -> None:
    theta, data = _pairs()
    ranks = calibration.ranks(_posterior_for(0.05), theta, data, samples=99)
    assert ranks.shape == (ROWS, 1)
    uniform = (ranks[:, 0].double() + torch.rand(ROWS)) / 100
    # p > .001: one seed in a thousand would fail; the seed is fixed.
    assert kstest(uniform.numpy(), "uniform").pvalue > 1e-3
    narrow = (calibration.ranks(_posterior_for(0.02), theta, data)[:, 0].double() + torch.rand(ROWS)) / 100
    assert kstest(narrow.numpy(), "uniform").pvalue < 1e-3


def test_balls_about_random_points_hold_the_truth_as_often_as_they_say() -> None:
    theta, data = _pairs()
    level = torch.tensor(calibration.LEVELS).double()
    generator = torch.Generator().manual_seed(0)

    def error(scale: float) -> float:
        found = calibration.tarp(_posterior_for(scale), theta, data, ONE, generator=generator)
        return float((found - level).abs().max())

    # The largest of ten correlated levels, each with a standard error of at most .025: four of them.
    assert error(0.05) < 0.1
    assert error(0.015) > 0.15
    assert error(0.2) > 0.15


def test_a_posterior_that_ignores_the_data_is_caught_by_points_that_do_not() -> None:
    theta, data = _pairs()
    deaf = TruncatedMixture(
        torch.zeros(ROWS, 1).double(),
        torch.full((ROWS, 1, 1), 0.5).double(),
        torch.full((ROWS, 1, 1, 1), 10.0).double(),
        Box(ONE, torch.tensor([0.3]).double(), torch.tensor([0.7]).double()),
    )
    level = torch.tensor(calibration.LEVELS).double()
    generator = torch.Generator().manual_seed(0)
    informed = calibration.tarp(
        lambda _: deaf, theta, data, ONE, references=ONE.from_unit(data["x"]), generator=generator
    )
    assert float((informed - level).abs().max()) > 0.3
