"""Worlds chosen from a belief, and costs over them."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from onlinebayes.control import CVaR, Mean, Unscented, WorstCase
from onlinebayes.runs import BadInput

COVARIANCE = torch.tensor([[2.0, 1.2, -0.3], [1.2, 1.0, 0.1], [-0.3, 0.1, 0.5]], dtype=torch.float64)


def costs() -> tuple[Tensor, Tensor]:
    values = torch.tensor([[1.0, 8.0], [2.0, 6.0], [3.0, 4.0], [4.0, 2.0]], dtype=torch.float64)
    return values, torch.full_like(values, 0.25)


@pytest.mark.parametrize("kappa", [0.0, 1.0, 3.0])
def test_the_points_of_a_correlated_belief_have_its_mean_and_covariance(kappa: float) -> None:
    mean = torch.tensor([1.0, -2.0, 5.0], dtype=torch.float64)
    points, weights = Unscented(kappa).points(mean, COVARIANCE)
    assert torch.allclose(weights.sum(), torch.ones(()).double())
    assert torch.allclose(weights @ points, mean)
    assert torch.allclose((points - mean).T @ (weights[:, None] * (points - mean)), COVARIANCE)


def test_the_points_of_a_singular_covariance_have_it_too() -> None:
    direction = torch.tensor([[1.0, 2.0, -1.0]], dtype=torch.float64)
    covariance = direction.T @ direction
    points, weights = Unscented().points(torch.zeros(3, dtype=torch.float64), covariance)
    assert torch.allclose(points.T @ (weights[:, None] * points), covariance, atol=1e-7)


def test_the_unscented_mean_of_a_quadratic_cost_is_exact() -> None:
    draws = torch.randn(500, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    draws = draws @ torch.linalg.cholesky(COVARIANCE).T
    points, weights = Unscented().worlds(draws, 8, torch.Generator())

    def cost(theta: Tensor) -> Tensor:
        return (theta[:, 0] + theta[:, 1]).square() + theta[:, 2] * theta[:, 0]

    assert torch.allclose(Unscented().over(cost(points)[:, None], weights[:, None]), cost(draws).mean())


def test_mean_worst_case_and_cvar_of_known_costs() -> None:
    values, weights = costs()
    assert Mean().over(values, weights).tolist() == [2.5, 5.0]
    assert WorstCase().over(values, weights).tolist() == [4.0, 8.0]
    assert CVaR(0.5).over(values, weights).tolist() == [3.5, 7.0]
    assert torch.allclose(CVaR(1.0).over(values, weights), Mean().over(values, weights))
    # Of three eighths the worst world counts whole and the next one in half.
    assert torch.allclose(CVaR(0.375).over(values, weights)[0], torch.tensor((4 * 0.25 + 3 * 0.125) / 0.375).double())


def test_a_world_without_weight_counts_for_nothing() -> None:
    values, weights = costs()
    weights[3], weights[0] = 0.0, 0.5
    assert WorstCase().over(values, weights).tolist() == [3.0, 8.0]
    assert CVaR(0.25).over(values, weights).tolist() == [3.0, 8.0]


@pytest.mark.parametrize("level", [0.0, -0.1, 1.5, float("nan")])
def test_a_level_that_is_no_share_is_refused(level: float) -> None:
    with pytest.raises(BadInput, match="share of the worst worlds"):
        CVaR(level)
