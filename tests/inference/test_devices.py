"""Inference on a GPU: estimators follow their networks, densities answer where theta lies, a seed repeats draws."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
import torch
from tensordict import TensorDict
from torch import Tensor

from envs.pendulum import Pendulum, PendulumTask
from onlinebayes.embeddings import StatisticsEmbedding, SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import (
    Alarm,
    Box,
    BoxUniform,
    EpsilonFree,
    FlowEstimator,
    FourierFeatures,
    Gate,
    LikelihoodEstimator,
    MixtureEstimator,
    NeuralEstimator,
    NeuralPosteriorLoss,
    PopulationABC,
    Posterior,
    PosteriorEstimator,
    RejectionABC,
    TruncatedMixture,
    calibration,
    corrected,
    cross_validate,
    filter_of,
    filtered_estimator,
    fit,
    identifiability,
    length_scales,
    plots,
    proposals,
    residual_estimator,
    saving,
)
from onlinebayes.inference.testing import check_estimator
from onlinebayes.inference.trust import in_words
from tests.inference import test_filtered as pendulums
from tests.inference import test_likelihood as slides
from tests.inference.test_protocol import PRIOR, SPACE, belief, simulate

pytestmark = pytest.mark.gpu

DEVICE = "cuda"
TRAIN = partial(fit, epochs=15, learning_rate=5e-3)


def there(theta: Tensor, generator: torch.Generator) -> TensorDict:
    """Trajectories that lie on the GPU."""
    return simulate(theta.cpu(), generator).to(DEVICE)


def summary() -> SummaryEmbedding:
    return SummaryEmbedding(TransitionFeatures(2, 1)).to(DEVICE)


def loss(length_scale: float | None = None, flow: str | None = None) -> NeuralPosteriorLoss:
    embedding = summary()
    if flow is not None:
        network = FlowEstimator(SPACE, embedding.size, kind=flow, layers=2, hidden=32)  # type: ignore[arg-type]
    elif length_scale is not None:
        trunk = FourierFeatures(embedding.size, 64, length_scale=length_scale)
        network = MixtureEstimator(SPACE, embedding.size, components=2, hidden=64, trunk=trunk)
    else:
        network = MixtureEstimator(SPACE, embedding.size, components=2, hidden=32)
    return NeuralPosteriorLoss(embedding, network.to(DEVICE))


def neural(**which) -> NeuralEstimator:
    return NeuralEstimator(loss(**which), TRAIN)


ESTIMATORS: dict[str, Callable[[], PosteriorEstimator]] = {
    "mixture": neural,
    "nsf": partial(neural, flow="nsf"),
    "maf": partial(neural, flow="maf"),
    "fourier": partial(neural, length_scale=5.0),
    "rejection": lambda: RejectionABC(summary(), SPACE, share=0.05),
    "adjusted": lambda: RejectionABC(summary(), SPACE, share=0.05, adjusted=True),
}


@pytest.mark.parametrize("place", ["cpu", DEVICE])
@pytest.mark.parametrize("kind", ESTIMATORS)
def test_an_estimator_keeps_the_protocol_wherever_the_data_lie(kind: str, place: str) -> None:
    check_estimator(ESTIMATORS[kind], lambda theta, draw: simulate(theta, draw).to(place), PRIOR)


@pytest.mark.parametrize("build", [filtered_estimator, residual_estimator])
def test_an_estimator_with_a_simulator_lies_where_that_does(build: Callable) -> None:
    made = build(
        Pendulum(pendulums.SPACE, device=DEVICE), PendulumTask(), state=pendulums.state, train=pendulums.TRAIN
    )(pendulums.PRIOR)
    assert made.loss.weight.device.type == DEVICE
    # Under noise one-step residuals learn nothing from so few: that is tested elsewhere.
    simulations = pendulums.simulate(pendulums.PRIOR.sample((200,)), torch.Generator().manual_seed(0))
    made.fit(simulations, generator=torch.Generator().manual_seed(0))
    draws = made.condition(simulations[:2]).sample((50,), torch.Generator().manual_seed(1))
    assert draws.device.type == DEVICE
    assert pendulums.SPACE.contains(draws).all()


def test_the_likelihood_on_a_gpu_is_that_of_the_cpu() -> None:
    draw = torch.Generator().manual_seed(0)
    theta = slides.PRIOR.sample((3,), draw)
    groups = torch.stack([slides.simulate(theta, draw) for _ in range(2)], dim=1)
    simulations = slides.simulate(slides.PRIOR.sample((100,), draw), draw)
    found = {}
    for device in ("cpu", DEVICE):
        system = slides.Slide(slides.SPACE, device=device)
        model = filter_of(system, slides.Watching(), Box.whole(slides.SPACE), state=slides.state)
        made = LikelihoodEstimator(model, Box.whole(slides.SPACE), 1, draws=200, enough=400.0)
        made.fit(simulations, generator=draw)
        made.model.noise.copy_(slides.NOISE)
        batch = made.each(groups.to(device))
        found[device] = batch.log_prob(theta)
        assert batch.sample((5,), torch.Generator().manual_seed(2)).device.type == device
        assert ((batch.credibility(theta) >= 0) & (batch.credibility(theta) <= 1)).all()
    # The evidence comes from some hundred weighted draws, the same on both up to rounding.
    torch.testing.assert_close(found[DEVICE], found["cpu"], rtol=0, atol=1e-3)


def test_a_density_answers_where_theta_lies() -> None:
    theta = PRIOR.sample((20,), torch.Generator().manual_seed(0))
    mixture = belief(0.4, 0.1)
    flow = loss(flow="nsf").estimator.distribution(torch.randn(1, summary().size, device=DEVICE))[0]
    cut = proposals.truncated(moved(mixture), generator=torch.Generator().manual_seed(0))
    marginal = Posterior(loss()).marginal(["b"])
    for density, points in ((moved(mixture), theta), (flow, theta), (cut, theta), (marginal, theta[:, 1:])):
        here, far = density.log_prob(points), density.log_prob(points.to(DEVICE))
        assert (here.device.type, far.device.type) == ("cpu", DEVICE)
        torch.testing.assert_close(here, far.cpu())
    torch.testing.assert_close(moved(mixture).log_prob(theta), mixture.log_prob(theta))


def moved(mixture: TruncatedMixture) -> TruncatedMixture:
    values = (mixture.log_weights, mixture.mean, mixture.scale_tril)
    return TruncatedMixture(*(value.to(DEVICE) for value in values), mixture.box)


@pytest.mark.parametrize("place", ["cpu", DEVICE])
def test_proposals_narrow_widen_and_repeat_their_draws(place: str) -> None:
    generator = torch.Generator(place).manual_seed(0)
    first = proposals.truncated(moved(belief(0.4, 0.05)), PRIOR, generator=generator)
    second = proposals.truncated(moved(belief(0.45, 0.03)), first, generator=generator)
    wide = proposals.wider(second, generator=generator)
    one, other = (second.sample((500,), torch.Generator(place).manual_seed(1)) for _ in range(2))
    assert torch.equal(one, other)
    assert second.contains(one).all()
    assert wide.contains(one.cpu()).all()
    assert first.contains(one).double().mean() > 0.99
    decision = Gate().decide(
        moved(belief(0.4, 0.05)), first, torch.linspace(0, 1, 64, device=DEVICE), generator=generator
    )
    assert decision.narrowed
    around = proposals.truncated(
        loss(flow="nsf").estimator.distribution(torch.randn(1, summary().size, device=DEVICE))[0], generator=generator
    )
    assert isinstance(around, BoxUniform)
    assert around.sample((5,), generator).shape == (5, 2)


@pytest.mark.parametrize("flow", [None, "nsf"])
def test_a_posterior_goes_through_a_file(tmp_path: Path, flow: str | None) -> None:
    made = neural(flow=flow)
    generator = torch.Generator().manual_seed(0)
    made.fit(there(PRIOR.sample((100,), generator), generator), generator=generator)
    posterior = made.condition(there(PRIOR.sample((2,), generator), generator))
    cut = proposals.truncated(moved(belief(0.4, 0.05)), PRIOR, generator=generator)
    for each in (posterior, cut):
        saving.save(each, tmp_path / "it.json")
        again, far = saving.load(tmp_path / "it.json"), saving.load(tmp_path / "it.json", device=DEVICE)
        theta = again.sample((20,), torch.Generator().manual_seed(1))
        assert theta.device.type == "cpu"
        draws = far.sample((20,), torch.Generator().manual_seed(1))
        assert draws.device.type == DEVICE
        # The draws are made on the CPU from the same numbers; weights and splines may round in another way.
        torch.testing.assert_close(draws.cpu(), theta, rtol=1e-4, atol=1e-4)
        torch.testing.assert_close(far.log_prob(theta), each.log_prob(theta), rtol=1e-4, atol=1e-4)


def test_weights_come_back_from_a_checkpoint() -> None:
    one, other = loss(), loss()
    generator = torch.Generator().manual_seed(0)
    data = there(PRIOR.sample((100,), generator), generator)
    fit(one, data, generator=generator, epochs=2)
    other.load_state_dict({key: value.cpu() if isinstance(value, Tensor) else value
                           for key, value in one.state_dict().items()})  # fmt: skip
    torch.testing.assert_close(other(data)["loss_posterior"], one(data)["loss_posterior"])


@pytest.mark.parametrize("place", ["cpu", DEVICE])
def test_calibration(place: str) -> None:
    posterior, generator = Posterior(loss()), torch.Generator(place).manual_seed(0)
    theta = PRIOR.sample((30,), torch.Generator().manual_seed(0))
    data = simulate(theta, torch.Generator().manual_seed(1))
    told = {"samples": 50, "generator": generator}
    for thetas in (theta, theta.to(DEVICE)):
        assert calibration.coverage(posterior.each, thetas, data, **told).shape == (10,)
        assert calibration.ranks(posterior.each, thetas, data, **told).shape == (30, 2)
        assert calibration.tarp(posterior.each, thetas, data, SPACE, **told).shape == (10,)
        assert "of 30 truths" in in_words(posterior.each, thetas, data, SPACE, **told)


@pytest.mark.parametrize("place", ["cpu", DEVICE])
def test_epsilon_free_rounds(place: str) -> None:
    generator = torch.Generator(place).manual_seed(0)

    def simulated(theta: Tensor, draw: torch.Generator) -> TensorDict:
        assert theta.device.type == place
        return there(theta, torch.Generator().manual_seed(int(torch.randint(99, (), generator=draw, device=place))))

    sampler = EpsilonFree(
        lambda _: summary(), PRIOR, simulated, rounds=2, simulations=200, train=partial(fit, epochs=5)
    )
    run = sampler.run(there(SPACE.from_unit(torch.tensor([[0.4, 0.6]]).double()), torch.Generator()), generator)
    theta = run.belief.sample((50,), torch.Generator().manual_seed(0))
    assert theta.device.type == DEVICE
    assert PRIOR.contains(theta).all()
    narrow = corrected(moved(belief(0.4, 0.05)), moved(belief(0.5, 0.2)))
    plain = corrected(belief(0.4, 0.05), belief(0.5, 0.2))
    torch.testing.assert_close(narrow.mean.cpu(), plain.mean)


@pytest.mark.parametrize("place", ["cpu", DEVICE])
def test_population_abc(place: str) -> None:
    def simulated(theta: Tensor, draw: torch.Generator) -> TensorDict:
        assert theta.device.type == place
        return there(theta, torch.Generator().manual_seed(int(torch.randint(99, (), generator=draw, device=place))))

    measured = there(SPACE.from_unit(torch.tensor([[0.4, 0.6]]).double()), torch.Generator())
    sampler = PopulationABC(summary(), PRIOR, simulated, particles=50, batch=200, simulations=1500)
    found = sampler.run(measured, torch.Generator(place).manual_seed(0))
    assert len(found.tolerances) > 1
    assert found.belief.sample((10,), torch.Generator().manual_seed(0)).device.type == DEVICE


def test_alarm_words_and_pictures() -> None:
    generator = torch.Generator().manual_seed(0)
    simulations = there(PRIOR.sample((300,), generator), generator)
    embedding = StatisticsEmbedding(TransitionFeatures(2, 1)).to(DEVICE)
    values = (simulations["observation"], simulations["action"], simulations["next", "observation"])
    embedding.fit(*values, torch.ones(300, 4, dtype=torch.bool, device=DEVICE))
    alarm = Alarm(embedding, simulations)
    strange = there(PRIOR.sample((2,), generator), generator)
    assert 0 < alarm.check(strange).p <= 1
    strange["next", "observation"] = strange["next", "observation"] + 30.0
    assert alarm.check(strange.cpu())
    made = moved(belief(0.4, 0.05))
    assert "known" in str(identifiability(made, PRIOR.box))
    plots.corner(made, prior=PRIOR, truth=PRIOR.sample(), samples=500)


@pytest.mark.parametrize("place", ["cpu", DEVICE])
def test_length_scales_by_cross_validation(place: str) -> None:
    generator = torch.Generator().manual_seed(0)
    simulations = simulate(PRIOR.sample((60,), generator), generator)
    scales = length_scales(loss(length_scale=1.0), simulations, (0.5, 2.0))
    draw, train = torch.Generator(place).manual_seed(0), partial(fit, epochs=2)
    choice = cross_validate(lambda scale: loss(length_scale=scale), simulations, scales, generator=draw, train=train)
    assert choice.length_scale in scales
