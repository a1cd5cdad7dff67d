"""Fourier features stand for the kernel that they name, and carry a posterior estimator."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import pytest
import torch

from onlinebayes.embeddings import SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import FourierFeatures, MixtureEstimator, NeuralEstimator, NeuralPosteriorLoss, fit
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
