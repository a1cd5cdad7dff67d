"""Noise about a plan, and bounds of commands."""

from __future__ import annotations

import pytest
import torch
from torchrl.data import Bounded, OneHot

from onlinebayes.control import Bounds, Coloured, Knots, Noise, White
from onlinebayes.runs import BadInput

NOISES = (White(1.0), Knots(1.0, 5), Knots(1.0, 6, degree=3), Coloured(1.0, 2.0), Coloured(1.0, 0.0))


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("horizon", [2, 7, 50])
def test_every_step_has_the_same_variance(noise: Noise, horizon: int) -> None:
    factor = noise.factor(horizon)
    assert factor.shape[0] == horizon
    assert torch.allclose(factor.square().sum(1), torch.ones(horizon, dtype=torch.float64))


def test_knots_and_colour_join_neighbouring_steps() -> None:
    def neighbours(noise: Noise) -> float:
        factor = noise.factor(50)
        return float((factor[1:] * factor[:-1]).sum(1).min())

    assert neighbours(White(1.0)) == 0
    assert neighbours(Knots(1.0, 5)) > 0.9
    assert 0.1 < neighbours(Coloured(1.0, 1.0)) < neighbours(Coloured(1.0, 2.0)) < 1


def test_a_flat_spectrum_is_white() -> None:
    factor = Coloured(1.0, 0.0).factor(20)
    covariance = factor @ factor.T
    assert float((covariance - torch.eye(20)).abs().max()) < 0.1


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (lambda: White(0.0), "sd 0"),
        (lambda: Coloured((1.0, -1.0)), "sd"),
        (lambda: Knots(1.0, 3, degree=3), "3 knots"),
        (lambda: Coloured(1.0, -1.0), "exponent -1"),
        (lambda: Bounds((1.0,), (-1.0,)), r"command 0 is bounded by \[1, -1\]"),
        (lambda: Bounds((-1.0,), (1.0, 2.0)), "1 lower and 2 upper"),
        (lambda: Bounds((-1.0,), (1.0,), rate=0.0), "a rate is positive"),
        (lambda: Bounds((-1.0,), (1.0,), rate=(1.0, 2.0)), "2 rates for 1"),
        (lambda: Bounds.of(OneHot(2)), "bounded commands"),
    ],
)
def test_bad_settings_are_refused(make: object, problem: str) -> None:
    with pytest.raises(BadInput, match=problem):
        make()  # type: ignore[operator]


def test_plans_are_moved_within_bounds_and_rates() -> None:
    bounds = Bounds((-1.0,), (2.0,), rate=5.0)
    plan = torch.tensor([[[3.0], [3.0], [-3.0], [0.9]]])
    admitted = bounds.admit(plan, torch.zeros(1, 1), dt=0.1)
    assert torch.allclose(admitted[0, :, 0], torch.tensor([0.5, 1.0, 0.5, 0.9]))
    free = Bounds((-1.0,), (2.0,)).admit(plan, torch.zeros(1, 1), dt=0.1)
    assert free[0, :, 0].tolist() == [2.0, 2.0, -1.0, pytest.approx(0.9)]


def test_bounds_are_read_off_a_task() -> None:
    bounds = Bounds.of(Bounded(torch.tensor([-1.0, 0.0]), torch.tensor([1.0, 3.0]), (2,)))
    assert (bounds.low, bounds.high, bounds.number) == ((-1.0, 0.0), (1.0, 3.0), 2)
