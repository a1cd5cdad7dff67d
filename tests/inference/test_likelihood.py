"""The posterior by a filter's likelihood is the exact one on a linear system, and keeps the estimators' promises."""

from __future__ import annotations

import math

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.inference import Box, BoxUniform, LikelihoodEstimator, filter_of
from onlinebayes.inference.testing import check_estimator
from tests.slide import STEPS, Slide, Watching, least_squares, measured, state

SPACE = Slide.physical
PRIOR = BoxUniform(SPACE)
NOISE = torch.tensor([0.05, 0.1], dtype=torch.float64)


def simulate(theta: torch.Tensor, generator: torch.Generator) -> TensorDict:
    seen, action = measured(SPACE, theta, NOISE, generator)
    after = TensorDict({"observation": seen[:, 1:]}, batch_size=action.shape[:2])
    values = {"observation": seen[:, :-1], "action": action, "theta": theta[:, None].expand(-1, STEPS, -1)}
    return TensorDict({**values, "next": after}, batch_size=action.shape[:2])


def estimator(draws: int = 500) -> LikelihoodEstimator:
    model = filter_of(Slide(SPACE), Watching(), Box.whole(SPACE), state=state)
    made = LikelihoodEstimator(model, Box.whole(SPACE), 1, draws=draws, enough=2.0 * draws)
    made.model.noise.copy_(NOISE)
    return made


def test_on_a_linear_system_it_is_exact() -> None:
    draw = torch.Generator().manual_seed(0)
    theta = SPACE.from_unit(torch.full((6, 2), 0.5).double())
    groups = torch.stack([simulate(theta, draw) for _ in range(4)], dim=1)
    batch = estimator().each(groups)
    assert bool((batch.effective > 500).all())
    for g in range(6):
        told = [
            least_squares(SPACE, torch.cat([one["observation"][:1], one["next", "observation"]]), one["action"], NOISE)
            for one in groups[g]
        ]
        information, pull = (sum(part) for part in zip(*told, strict=True))
        mean, covariance = torch.linalg.solve(information, pull), torch.linalg.inv(information)
        gaussian = torch.distributions.MultivariateNormal(mean, covariance)
        points = mean + 1.5 * torch.randn(5, 2, generator=draw).double() @ torch.linalg.cholesky(covariance).T
        found = batch[g].log_prob(SPACE.from_unit(points)) + math.log(4.0)
        # A thousand weighted draws: the evidence is right to 3 %; the box cuts off next to nothing.
        torch.testing.assert_close(found, gaussian.log_prob(points), rtol=0, atol=0.1)
        drawn = SPACE.to_unit(batch[g].sample((2000,), draw))
        sd = covariance.diagonal().sqrt()
        assert bool(((drawn.mean(0) - mean).abs() < 0.15 * sd).all())
        assert bool(((drawn.std(0) / sd - 1).abs() < 0.1).all())


def test_its_credibilities_are_those_of_its_density() -> None:
    draw = torch.Generator().manual_seed(1)
    theta = PRIOR.sample((8,), draw)
    posterior = estimator().each(simulate(theta, draw)[:, None])
    drawn = posterior.sample((300,), draw)
    by_hand = (posterior.log_prob(drawn) >= posterior.log_prob(theta)).double().mean(0)
    torch.testing.assert_close(posterior.credibility(theta).double(), by_hand, rtol=0, atol=0.12)  # 4 sd of 300 draws


@pytest.mark.slow
def test_it_keeps_the_protocol() -> None:
    check_estimator(lambda: estimator(200), simulate, PRIOR, simulations=300)
