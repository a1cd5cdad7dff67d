"""Fourier features stand for the kernel that they name, and carry a posterior estimator."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import pytest
import torch
from scipy import special

from onlinebayes.embeddings import SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import (
    FourierFeatures,
    MixtureEstimator,
    NeuralEstimator,
    NeuralPosteriorLoss,
    cross_validate,
    fit,
    length_scales,
)
from onlinebayes.inference.testing import check_estimator
from onlinebayes.runs import BadInput
from tests.inference.test_protocol import PRIOR, SPACE, simulate

KERNELS: dict[str, Callable[[torch.Tensor], torch.Tensor]] = {
    "rbf": lambda r: torch.exp(-(r**2) / 2),
    "matern12": lambda r: torch.exp(-r),
    "matern32": lambda r: (1 + math.sqrt(3) * r) * torch.exp(-math.sqrt(3) * r),
    "matern52": lambda r: (1 + math.sqrt(5) * r + 5 / 3 * r**2) * torch.exp(-math.sqrt(5) * r),
}


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("size", [1, 3, 10])
def test_inner_products_are_the_kernel(kernel: str, size: int) -> None:
    features = FourierFeatures(size, 8192, kernel=kernel, length_scale=2.0).double()
    draw = torch.Generator().manual_seed(0)
    x = torch.randn(60, size, generator=draw, dtype=torch.float64)
    y = x + torch.randn(60, size, generator=draw, dtype=torch.float64) * torch.linspace(0, 2, 60).double()[:, None]
    found = (features(x) * features(y)).sum(-1) / 2
    # 4096 frequencies: independent ones would err by .011 at most, a standard deviation.
    torch.testing.assert_close(found, KERNELS[kernel]((x - y).norm(dim=-1) / 2), rtol=0, atol=0.03)
    torch.testing.assert_close(features(x).norm(dim=-1), torch.full((60,), math.sqrt(2)).double())


@pytest.mark.parametrize(("kernel", "nu"), [("matern12", 0.5), ("matern32", 1.0), ("matern52", 2.0)])
def test_legacy_features_stand_for_a_product_of_other_kernels(kernel: str, nu: float) -> None:
    """In every dimension the Matern kernel of half the degrees of freedom that the published code draws."""
    features = FourierFeatures(3, 8192, kernel=kernel, length_scale=2.0, legacy=True).double()
    draw = torch.Generator().manual_seed(0)
    x = torch.randn(60, 3, generator=draw, dtype=torch.float64)
    y = x + torch.randn(60, 3, generator=draw, dtype=torch.float64)
    found = (features(x) * features(y)).sum(-1) / 2
    scaled = math.sqrt(2 * nu) * ((x - y).abs() / 2).numpy()
    matern = scaled**nu * special.kv(nu, scaled) * 2 ** (1 - nu) / special.gamma(nu)
    torch.testing.assert_close(found, torch.from_numpy(matern.prod(-1)), rtol=0, atol=0.03)


def _make(length_scale: float) -> NeuralPosteriorLoss:
    embedding = SummaryEmbedding(TransitionFeatures(2, 1, products=False))
    trunk = FourierFeatures(embedding.size, 128, length_scale=length_scale)
    network = MixtureEstimator(SPACE, embedding.size, components=1, hidden=128, trunk=trunk)
    # The straight path would do without features.
    network.straight.weight.requires_grad_(False).zero_()
    return NeuralPosteriorLoss(embedding, network)


def test_cross_validation_leaves_out_length_scales_that_cannot_work() -> None:
    data = simulate(PRIOR.sample((300,)), torch.Generator().manual_seed(0))
    (median,) = length_scales(_make(1.0), data, factors=(1.0,))
    # Distances between standardised vectors of 5 values, two independent of each other: sqrt(2 * 5) about.
    assert 2 < median < 4
    scales, train = [median / 100, median, median * 1000], partial(fit, epochs=8, learning_rate=5e-3)
    before = torch.get_rng_state()
    choices = [
        cross_validate(_make, data, scales, generator=torch.Generator().manual_seed(0), folds=2, train=train)
        for _ in range(2)
    ]
    assert choices[0].length_scale == median
    assert choices[0].losses == choices[1].losses
    assert torch.equal(torch.get_rng_state(), before)
    assert choices[0].losses[median] < min(choices[0].losses[scale] for scale in (scales[0], scales[2])) - 0.1


def test_cross_validation_refuses_nonsense() -> None:
    data, generator = simulate(PRIOR.sample((5,)), torch.Generator().manual_seed(0)), torch.Generator()
    with pytest.raises(BadInput, match="0 length scales, 3 folds of 5 simulations"):
        cross_validate(_make, data, [], generator=generator)
    with pytest.raises(BadInput, match="1 length scales, 3 folds of 5 simulations"):
        cross_validate(_make, data, [1.0], generator=generator)
    with pytest.raises(BadInput, match="the median distance between 5 embeddings is 0"):
        length_scales(_make(1.0), torch.stack([data[0]] * 5))


def test_heads_on_fourier_features_are_an_estimator() -> None:
    def made() -> NeuralEstimator:
        embedding = SummaryEmbedding(TransitionFeatures(2, 1))
        trunk = FourierFeatures(embedding.size, 128, kernel="matern32")
        network = MixtureEstimator(SPACE, embedding.size, components=2, hidden=128, trunk=trunk)
        return NeuralEstimator(NeuralPosteriorLoss(embedding, network), partial(fit, epochs=15, learning_rate=5e-3))

    check_estimator(made, simulate, PRIOR)


def test_a_seed_repeats_the_frequencies_and_nonsense_is_refused() -> None:
    first, second = (FourierFeatures(4, 20, seed=3).frequencies for _ in range(2))
    assert torch.equal(first, second)
    with pytest.raises(BadInput, match="7 Fourier features"):
        FourierFeatures(4, 7)
    with pytest.raises(BadInput, match="length scale -1"):
        FourierFeatures(4, 8, length_scale=-1.0)
