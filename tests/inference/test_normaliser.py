"""The mass of a Gaussian in the unit cube against scipy, and its gradients."""

from __future__ import annotations

import pytest
import torch
from scipy.stats import multivariate_normal

from onlinebayes.inference.distributions.normal import between, inverse_log_ndtr, log_interval
from onlinebayes.inference.distributions.normaliser import log_mass_in_cube


def _random(size: int, count: int, spread: float) -> tuple[torch.Tensor, torch.Tensor]:
    mean = 0.5 + 0.75 * (2 * torch.rand(count, size, dtype=torch.float64) - 1)
    diagonal = torch.exp(spread * torch.randn(count, size, dtype=torch.float64)) * 0.3
    shear = torch.randn(count, size, size, dtype=torch.float64).tril(-1) * diagonal.unsqueeze(-1)
    return mean, torch.diag_embed(diagonal) + shear


# scipy's own integrator promises 1e-5; the Sobol estimate with 128 points 2 %.
@pytest.mark.parametrize(("size", "tolerance"), [(1, 1e-7), (2, 1e-4), (3, 0.02), (5, 0.05)])
def test_mass_equals_scipys(size: int, tolerance: float) -> None:
    mean, lower = _random(size, 40 if size < 5 else 8, 0.7)
    ours = log_mass_in_cube(mean, lower).exp()
    for i in range(len(mean)):
        cdf = multivariate_normal(
            mean[i].numpy(), (lower[i] @ lower[i].T).numpy(), abseps=1e-8, releps=1e-8, maxpts=200_000, seed=1
        )
        theirs = cdf.cdf([1.0] * size, lower_limit=[0.0] * size)
        assert abs(float(ours[i]) - theirs) < tolerance * max(theirs, 0.05), (i, float(ours[i]), theirs)


@pytest.mark.parametrize("size", [1, 2, 4])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_far_outside_and_needle_like_is_finite_with_finite_gradients(size: int, dtype: torch.dtype) -> None:
    for where, scale in [(30.0, 0.01), (-30.0, 0.01), (0.0, 1e-4), (1.0, 1e-4), (0.5, 1e3), (1e3, 1e-3)]:
        mean = torch.full((size,), where, dtype=dtype, requires_grad=True)
        lower = (scale * torch.eye(size, dtype=dtype)).requires_grad_()
        value = log_mass_in_cube(mean, lower)
        value.backward()
        assert torch.isfinite(value)
        assert value < 1e-3
        assert mean.grad is not None
        assert torch.isfinite(mean.grad).all()
        assert lower.grad is not None
        assert torch.isfinite(lower.grad).all()


@pytest.mark.parametrize("size", [1, 2, 3])
def test_gradients_are_right(size: int) -> None:
    mean, lower = _random(size, 3, 0.3)
    rows, columns = torch.tril_indices(size, size)

    def mass(mean: torch.Tensor, entries: torch.Tensor) -> torch.Tensor:
        full = torch.zeros(3, size, size, dtype=torch.float64)
        full[:, rows, columns] = entries
        return log_mass_in_cube(mean, full)

    entries = lower[:, rows, columns]
    assert torch.autograd.gradcheck(
        mass, (mean.requires_grad_(), entries.detach().requires_grad_()), atol=1e-5, rtol=1e-4
    )


def test_a_sharp_ridge_across_the_box() -> None:
    # Correlation 0.9999 along the diagonal, centre in the middle: the mass is that of a one-dimensional cut.
    lower = torch.tensor([[[1.0, 0.0], [1.0, 0.0141]]], dtype=torch.float64)
    mean = torch.full((1, 2), 0.5, dtype=torch.float64)
    exact = torch.as_tensor(
        multivariate_normal([0.5, 0.5], (lower[0] @ lower[0].T).numpy()).cdf([1, 1], lower_limit=[0, 0])
    )
    torch.testing.assert_close(log_mass_in_cube(mean, lower).exp()[0], exact, rtol=2e-3, atol=0)


def test_inverse_of_log_ndtr() -> None:
    x = torch.tensor([-300.0, -38.0, -10.0, -3.0, 0.0, 1.0, 3.0], dtype=torch.float64)
    torch.testing.assert_close(inverse_log_ndtr(torch.special.log_ndtr(x)), x, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("a", "b"), [(-1.0, 2.0), (30.0, 31.0), (-31.0, -30.0), (-9.0, 9.0), (1e3, 2e3), (-0.001, 0.001)]
)
def test_between_stays_between_and_follows_the_mass(a: float, b: float) -> None:
    low, high = torch.tensor(a, dtype=torch.float64), torch.tensor(b, dtype=torch.float64)
    w = torch.linspace(0, 1, 101, dtype=torch.float64)[1:-1]
    x = between(low.expand_as(w), high.expand_as(w), w)
    assert ((x >= low) & (x <= high)).all()
    assert (x.diff() > 0).all()
    share = (log_interval(low.expand_as(x), x) - log_interval(low, high)).exp()
    torch.testing.assert_close(share, w, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(
    ("mean", "lower", "expected"),
    [
        # A needle along the first side that leaks over the second: a scan of the first side would step over it.
        ([0.41322, 0.03336], [[3.408e-07, 0.0], [0.07422, 0.03091]], -0.41417),
        ([0.52906, 1.05395], [[2.182e-04, 0.0], [0.04187, 0.01284]], -2.21442),
        ([0.47781, -0.03752], [[2.705e-07, 0.0], [2.74098, 1.74225]], None),
    ],
)
def test_a_needle_that_leaks(mean: list[float], lower: list[list[float]], expected: float | None) -> None:
    ours = float(log_mass_in_cube(torch.tensor(mean).double(), torch.tensor(lower).double()))
    # The first coordinate never reaches a side, so that the mass is the second one's alone: one difference of Phi.
    sd = (lower[1][0] ** 2 + lower[1][1] ** 2) ** 0.5
    alone = float(log_interval(torch.tensor(-mean[1] / sd).double(), torch.tensor((1 - mean[1]) / sd).double()))
    assert abs(ours - alone) < 1e-3
    assert expected is None or abs(ours - expected) < 2e-3
