"""Flows on a box: normalised, drawn from as they say, close to exact posteriors, the same after saving.

Tolerance: as in ``test_exact_posteriors`` the Kullback-Leibler divergence from the exact posterior, averaged over
50 fresh observations, is below TOLERANCE nats; the prior's is above 1.
"""

from __future__ import annotations

import math
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
import torch

from onlinebayes.embeddings import SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import (
    Box,
    BoxUniform,
    FlowEstimator,
    NeuralEstimator,
    NeuralPosteriorLoss,
    Posterior,
    fit,
    proposals,
    saving,
)
from onlinebayes.inference.distributions import FlowDensity
from onlinebayes.inference.saving import from_state, to_state
from onlinebayes.inference.testing import check_estimator
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.runs.checkpoints import Checkpoints
from tests.inference.systems import exact_log_prob, trajectories
from tests.inference.test_distributions import ONE, THREE, TWO, _grid
from tests.inference.test_exact_posteriors import LINEAR, SD, SQUARE, _divergence, _linear
from tests.inference.test_protocol import PRIOR, SPACE, simulate

KINDS = ["nsf", "maf"]
TOLERANCE = 0.1


def _flow(space: ParameterSpace, kind: str, *, batch: int = 2, box: Box | None = None) -> FlowDensity:
    """Flows of random weights, those of splines twice as large as at the start of a training."""
    torch.manual_seed(0)
    network = FlowEstimator(space, 3, kind=kind, hidden=16, box=box).requires_grad_(False)  # type: ignore[arg-type]
    for weight in network.bijection.parameters():
        weight.mul_(2 if kind == "nsf" else 1)
    return network.distribution(torch.randn(batch, 3))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("space", [ONE, TWO])
def test_a_flow_is_normalised_over_its_box_and_drawn_from_as_it_says(space: ParameterSpace, kind: str) -> None:
    size = len(space)
    low, high = torch.full((size,), 0.2).double(), torch.full((size,), 0.7).double()
    flow = _flow(space, kind, box=Box(space, low, high))
    count = 500 if size == 2 else 100_000
    axis = (torch.arange(count).double() + 0.5) / count
    z = torch.cartesian_prod(*[axis] * size).reshape(-1, size)
    mass = flow.log_prob_frame(z.unsqueeze(1)).exp().double() / len(z)
    torch.testing.assert_close(mass.sum(0), torch.ones(2).double(), rtol=0, atol=0.01)
    draws = flow.sample_frame((20_000,), torch.Generator().manual_seed(1))
    # Shares of 20000 draws err by .0035 at most, a standard deviation: four of them for eight shares.
    for level in (0.1, 0.5):
        below = (z < level).all(-1, keepdim=True)
        found = (draws < level).all(-1).double().mean(0)
        torch.testing.assert_close(found, (mass * below).sum(0), rtol=0, atol=0.014 + 0.01)
    theta = flow.sample((100,))
    assert flow.box.contains(theta).all()
    assert torch.isinf(flow.log_prob(space.high.double())).all()


@pytest.mark.parametrize("kind", KINDS)
def test_on_the_very_edge_the_density_is_that_beside_it(kind: str) -> None:
    flow = _flow(TWO, kind)
    for corner, inner in ((0.0, 1e-6), (1.0, 1 - 1e-6)):
        values = [flow.log_prob_frame(torch.full((1, 2), z).double()) for z in (corner, inner)]
        torch.testing.assert_close(*values)


def _loss(space: ParameterSpace, kind: str, rows: int = 6000, mean: object = _linear) -> NeuralPosteriorLoss:
    generator = torch.Generator().manual_seed(1)
    data = trajectories(BoxUniform(space).sample((rows,), generator), mean, SD, generator)  # type: ignore[arg-type]
    embedding = SummaryEmbedding(TransitionFeatures(data["observation"].shape[-1], 1, products=False))
    network = FlowEstimator(space, embedding.size, kind=kind)  # type: ignore[arg-type]
    loss = NeuralPosteriorLoss(embedding, network)
    fit(loss, data, generator=generator, epochs=15, batch_size=200, learning_rate=5e-3)
    return loss


@pytest.fixture(scope="module")
def linear() -> NeuralPosteriorLoss:
    torch.manual_seed(0)
    return _loss(LINEAR, "nsf")


def test_linear_gaussian_in_a_box(linear: NeuralPosteriorLoss) -> None:
    generator = torch.Generator().manual_seed(2)
    fresh = trajectories(BoxUniform(LINEAR).sample((50,), generator), _linear, SD, generator)
    assert _divergence(BoxUniform(LINEAR).log_prob, fresh, LINEAR, _linear).mean() > 1
    assert _divergence(Posterior(linear).each(fresh).log_prob, fresh, LINEAR, _linear).mean() < TOLERANCE


def test_a_truth_in_the_corner_of_the_box_is_a_place_like_any_other(linear: NeuralPosteriorLoss) -> None:
    generator = torch.Generator().manual_seed(3)
    corner = torch.tensor([[4.0, 1.0]]).double().expand(50, 2)
    seen = trajectories(corner, _linear, SD, generator)
    points, volumes = _grid(LINEAR, 200)
    exact = exact_log_prob(seen, points, volumes, LINEAR, _linear, SD)[:, -1]  # the cell in the corner
    ours = Posterior(linear).each(seen).log_prob(corner)
    # 2.1 nats is the exact density, -1.4 the prior's.
    assert abs(float((ours - exact).mean())) < 1


def test_two_modes() -> None:
    posterior, generator = Posterior(_loss(SQUARE, "nsf", mean=torch.square)), torch.Generator().manual_seed(2)
    fresh = trajectories(BoxUniform(SQUARE).sample((50,), generator), torch.square, SD, generator)
    assert _divergence(posterior.each(fresh).log_prob, fresh, SQUARE, torch.square).mean() < TOLERANCE


def _estimator(kind: str, epochs: int = 15) -> NeuralEstimator:
    embedding = SummaryEmbedding(TransitionFeatures(2, 1))
    network = FlowEstimator(SPACE, embedding.size, kind=kind, hidden=32)  # type: ignore[arg-type]
    return NeuralEstimator(NeuralPosteriorLoss(embedding, network), partial(fit, epochs=epochs, learning_rate=5e-3))


@pytest.mark.parametrize("kind", KINDS)
def test_a_flow_keeps_the_protocol_and_combines_by_union(kind: str) -> None:
    estimator = _estimator(kind)
    assert math.isinf(estimator.combination)
    check_estimator(lambda: estimator, simulate, PRIOR)
    assert math.isinf(estimator.combination)
    data = simulate(PRIOR.sample((3,)), torch.Generator().manual_seed(0)).exclude("theta")
    theta = PRIOR.sample((50,))
    single = Posterior(estimator.loss).each(data).log_prob(theta.unsqueeze(1))
    mean = single.logsumexp(-1) - math.log(3)
    torch.testing.assert_close(estimator.condition(data).log_prob(theta), mean, rtol=1e-4, atol=1e-4)
    with pytest.raises(BadInput, match="FlowEstimator have no product in closed form; use combine='union'"):
        Posterior(estimator.loss).condition(data, combine="product")


@pytest.mark.parametrize("kind", KINDS)
def test_it_is_the_same_to_the_last_bit_after_saving(kind: str, tmp_path: Path) -> None:
    estimator = _estimator(kind, epochs=1)
    generator = torch.Generator().manual_seed(0)
    estimator.fit(simulate(PRIOR.sample((100,), generator), generator), generator=generator)
    belief = estimator.condition(simulate(PRIOR.sample((3,), generator), generator).exclude("theta"))
    checkpoints = Checkpoints(tmp_path, "flows")
    checkpoints.save({"belief": to_state(belief)})
    loaded = checkpoints.load()
    assert loaded is not None
    before = torch.get_rng_state()
    again = from_state(SPACE, loaded.state["belief"])
    assert torch.equal(torch.get_rng_state(), before)
    saving.save(belief, tmp_path / "it.json")
    for other in (again, saving.load(tmp_path / "it.json", SPACE)):
        draws = [x.sample((200,), torch.Generator().manual_seed(1)) for x in (belief, other)]
        assert torch.equal(*draws)
        assert torch.equal(belief.log_prob(draws[0]), other.log_prob(draws[0]))


def test_a_proposal_follows_a_flow() -> None:
    estimator, generator = _estimator("nsf"), torch.Generator().manual_seed(0)
    estimator.fit(simulate(PRIOR.sample((600,), generator), generator, 0.05), generator=generator)
    truth = torch.tensor([[0.2, 1.4]]).double()
    belief = estimator.condition(simulate(truth, generator, 0.05).exclude("theta"))
    boxes = [proposals.truncated(belief, PRIOR, generator=torch.Generator().manual_seed(3)).box for _ in range(2)]
    assert torch.equal(boxes[0].low, boxes[1].low)
    assert boxes[0].contains(truth).all()


@pytest.mark.parametrize("space", [ONE, TWO, THREE])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_gradient_reaches_every_weight(space: ParameterSpace, kind: str, dtype: torch.dtype) -> None:
    network = FlowEstimator(space, 5, kind=kind, hidden=8).to(dtype)  # type: ignore[arg-type]
    value = -network.distribution(torch.randn(40, 5, dtype=dtype)).log_prob_frame(torch.rand(40, len(space))).mean()
    assert value.dtype == dtype
    value.backward()
    for name, weight in network.named_parameters():
        assert weight.grad is not None, name
        assert torch.isfinite(weight.grad).all(), name
        assert weight.grad.abs().max() > 0, name


@pytest.mark.usefixtures("without_shape_checks")
def test_nonsense_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(BadInput, match="a flow of kind 'rnvp'; known: nsf, maf"):
        FlowEstimator(ONE, 3, kind="rnvp")  # type: ignore[arg-type]
    one, other = _flow(TWO, "nsf"), _flow(TWO, "nsf")
    with pytest.raises(ValueError, match="different networks"):
        FlowEstimator(TWO, 3).united([one, other])
    monkeypatch.setitem(sys.modules, "zuko", None)
    with pytest.raises(BadInput, match=r"pip install 'onlinebayes\[flows\]'"):
        FlowEstimator(TWO, 3)


@pytest.mark.slow
def test_importing_inference_does_not_import_zuko() -> None:
    subprocess.run(
        [sys.executable, "-c", "import onlinebayes.inference, sys; assert 'zuko' not in sys.modules"], check=True
    )


@pytest.mark.gpu
@pytest.mark.parametrize("kind", KINDS)
def test_on_a_gpu(kind: str) -> None:
    network = FlowEstimator(TWO, 3, kind=kind).cuda()  # type: ignore[arg-type]
    flow = network.distribution(torch.randn(2, 3).cuda())
    draws = flow.sample((50,), torch.Generator().manual_seed(0))
    assert draws.device.type == "cuda"
    assert torch.isfinite(flow.log_prob(draws)).all()
