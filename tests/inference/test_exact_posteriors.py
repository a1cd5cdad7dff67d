"""The trained posterior against exact ones: linear Gaussian in a box, and two modes.

Tolerance: the Kullback-Leibler divergence from the exact posterior to the estimate, on a grid and averaged over 50
fresh observations, is below TOLERANCE nats, and below CORNER for truths in the very corner of the box, where half of
the observations lie at the rim of what training shows. That of the prior, which ignores the observation, is above
1 nat (also tested).
"""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.embeddings import LSTMEmbedding, TransitionFeatures
from onlinebayes.inference import BoxUniform, MixtureEstimator, NeuralPosteriorLoss, Posterior, calibration, fit
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import seed_everything
from tests.inference.systems import exact_log_prob, trajectories
from tests.inference.test_distributions import _grid

LINEAR = ParameterSpace({"a": Parameter(2.0, 4.0, "m"), "b": Parameter(-1.0, 1.0, "m")})
SQUARE = ParameterSpace({"a": Parameter(-1.0, 1.0, "m")})
A = torch.tensor([[1.0, 0.5], [-0.3, 1.0]], dtype=torch.float64)
SD = 0.4
TOLERANCE, CORNER = 0.08, 0.2


def _linear(theta: torch.Tensor) -> torch.Tensor:
    return theta @ A.T


def _fitted(space: ParameterSpace, mean: object, rows: int) -> NeuralPosteriorLoss:
    generator = torch.Generator().manual_seed(1)
    data = trajectories(BoxUniform(space).sample((rows,), generator), mean, SD, generator)  # type: ignore[arg-type]
    size = data["observation"].shape[-1]
    embedding = LSTMEmbedding(TransitionFeatures(size, 1, products=False), hidden=16)
    loss = NeuralPosteriorLoss(embedding, MixtureEstimator(space, embedding.size, components=4, hidden=64))
    fit(loss, data, generator=generator, epochs=20, batch_size=200, learning_rate=5e-3)
    return loss


def _divergence(log_prob: object, data: TensorDict, space: ParameterSpace, mean: object) -> torch.Tensor:
    """KL(exact || estimate) of each trajectory."""
    points, volumes = _grid(space, 60 if len(space) == 2 else 1000)
    exact = exact_log_prob(data, points, volumes, space, mean, SD)  # type: ignore[arg-type]
    ours = log_prob(points.unsqueeze(1)).T  # type: ignore[operator]
    return (exact.exp() * (exact - ours) * volumes).sum(-1)


@pytest.fixture(scope="module")
def linear() -> NeuralPosteriorLoss:
    seed_everything(0)
    return _fitted(LINEAR, _linear, 6000)


def test_linear_gaussian_in_a_box(linear: NeuralPosteriorLoss) -> None:
    posterior, generator = Posterior(linear), torch.Generator().manual_seed(2)
    fresh = trajectories(BoxUniform(LINEAR).sample((50,), generator), _linear, SD, generator)
    assert _divergence(BoxUniform(LINEAR).log_prob, fresh, LINEAR, _linear).mean() > 1
    assert _divergence(posterior.each(fresh).log_prob, fresh, LINEAR, _linear).mean() < TOLERANCE
    # A truth in the corner of the box: half of its posterior in each direction is cut away.
    corner = trajectories(torch.tensor([[4.0, 1.0]]).double().expand(50, 2), _linear, SD, generator)
    assert _divergence(posterior.each(corner).log_prob, corner, LINEAR, _linear).mean() < CORNER


def test_coverage_of_the_linear_gaussian(linear: NeuralPosteriorLoss) -> None:
    posterior, generator = Posterior(linear), torch.Generator().manual_seed(4)
    test = trajectories(BoxUniform(LINEAR).sample((400,), generator), _linear, SD, generator)
    covered = calibration.coverage(posterior.each, test["theta"], test, generator=generator)
    # Standard error of each level at most .025.
    assert (covered - torch.tensor(calibration.LEVELS)).abs().mean() < 0.05


def test_several_trajectories_multiply(linear: NeuralPosteriorLoss) -> None:
    loss, generator = linear, torch.Generator().manual_seed(3)
    truth = torch.tensor([[3.3, -0.2]]).double().expand(3, 2)
    real = trajectories(truth, _linear, SD, generator)
    points, volumes = _grid(LINEAR, 60)
    joint = exact_log_prob(real, points, volumes, LINEAR, _linear, SD).sum(0)
    joint = joint - torch.logsumexp(joint + torch.log(volumes), 0)
    posterior = Posterior(loss).condition(real, combine="product")
    divergence = (joint.exp() * (joint - posterior.log_prob(points)) * volumes).sum()
    assert divergence < 0.3, divergence
    union = Posterior(loss).condition(real)
    assert posterior.log_prob(posterior.mean()) > union.log_prob(union.mean())


def test_two_modes() -> None:
    posterior, generator = Posterior(_fitted(SQUARE, torch.square, 6000)), torch.Generator().manual_seed(2)
    fresh = trajectories(BoxUniform(SQUARE).sample((50,), generator), torch.square, SD, generator)
    assert _divergence(posterior.each(fresh).log_prob, fresh, SQUARE, torch.square).mean() < TOLERANCE
    seen = trajectories(torch.full((1, 1), 0.9).double(), torch.square, 0.05, generator)
    log_prob = posterior.condition(seen).log_prob(torch.tensor([[-0.8], [0.0], [0.8]]).double())
    assert log_prob[0] > log_prob[1] + 0.5
    assert log_prob[2] > log_prob[1] + 0.5


@pytest.mark.gpu
def test_it_trains_on_a_gpu() -> None:
    generator = torch.Generator().manual_seed(1)
    data = trajectories(BoxUniform(LINEAR).sample((300,), generator), _linear, SD, generator).cuda()
    embedding = LSTMEmbedding(TransitionFeatures(2, 1), hidden=16).cuda()
    loss = NeuralPosteriorLoss(embedding, MixtureEstimator(LINEAR, embedding.size)).cuda()
    report = fit(loss, data, generator=generator, epochs=5)
    assert report.validation[-1] < report.validation[0]
    assert LINEAR.contains(Posterior(loss).condition(data[:2]).sample((10,))).all()
