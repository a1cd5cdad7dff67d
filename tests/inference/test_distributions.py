"""Box, uniform and truncated mixture: one over the box, samples inside, edges, tails, original scale."""

from __future__ import annotations

import math

import pytest
import torch
from scipy.stats import kstest

from onlinebayes.inference import Box, BoxUniform, TruncatedMixture
from onlinebayes.parameters import Parameter, ParameterSpace

ONE = ParameterSpace({"a": Parameter(-2.0, 3.0, "m")})
TWO = ParameterSpace({"a": Parameter(-2.0, 3.0, "m"), "b": Parameter(0.01, 10.0, "kg", "log")})
THREE = TWO | ParameterSpace({"c": Parameter(0.0, 1e-3, "s")})


def _mixture(
    space: ParameterSpace, components: int = 3, spread: float = 0.3, box: Box | None = None
) -> TruncatedMixture:
    size = len(space)
    lower = torch.diag_embed(spread * (0.3 + torch.rand(components, size, dtype=torch.float64)))
    lower = lower + spread * torch.randn(components, size, size, dtype=torch.float64).tril(-1)
    mean = 0.5 + 0.7 * (2 * torch.rand(components, size, dtype=torch.float64) - 1)
    return TruncatedMixture(torch.randn(components, dtype=torch.float64), mean, lower, box or Box.whole(space))


def _grid(space: ParameterSpace, count: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Midpoints of a grid in theta (on the original scale, cells of equal ratio on a log scale) and cell volumes."""
    edges = torch.linspace(0, 1, count + 1, dtype=torch.float64)
    columns, widths = [], []
    for parameter in space.values():
        one = ParameterSpace({"x": parameter})
        ends = one.from_unit(edges.unsqueeze(1))[:, 0]
        columns.append((ends[1:] + ends[:-1]) / 2)
        widths.append(ends.diff())
    points = torch.cartesian_prod(*columns).reshape(-1, len(space))
    return points, torch.cartesian_prod(*widths).reshape(-1, len(space)).prod(-1)


# P <= 2 is quadrature, P = 3 the Sobol estimate; the grid's own midpoint error is below 1e-3.
@pytest.mark.parametrize(("space", "count", "tolerance"), [(ONE, 4000, 1e-5), (TWO, 400, 2e-3), (THREE, 80, 0.03)])
@pytest.mark.parametrize("spread", [0.15, 1.0])
def test_densities_integrate_to_one_over_the_box(
    space: ParameterSpace, count: int, tolerance: float, spread: float
) -> None:
    points, volumes = _grid(space, count)
    for distribution in (_mixture(space, spread=spread), BoxUniform(space)):
        total = float((distribution.log_prob(points).exp() * volumes).sum())
        assert total == pytest.approx(1.0, abs=tolerance)


def test_density_over_a_smaller_box_integrates_to_one_and_is_zero_outside() -> None:
    box = Box(TWO, torch.tensor([0.2, 0.4]).double(), torch.tensor([0.5, 0.9]).double())
    mixture, uniform = _mixture(TWO, box=box), BoxUniform(TWO, box)
    points, volumes = _grid(TWO, 400)
    for distribution in (mixture, uniform):
        log_prob = distribution.log_prob(points)
        assert float((log_prob.exp() * volumes).sum()) == pytest.approx(1.0, abs=2e-2)
        outside = ~box.contains(points)
        assert torch.isinf(log_prob[outside]).all()
        assert torch.isfinite(log_prob[~outside]).all()


@pytest.mark.parametrize("space", [ONE, TWO, THREE])
def test_samples_stay_inside_and_follow_the_density(space: ParameterSpace) -> None:
    mixture = _mixture(space, spread=0.5)
    theta = mixture.sample((20_000,))
    assert theta.dtype == torch.float64
    assert space.contains(theta).all()
    # Importance-weighted by 1 / q the samples must be uniform: E_q[f(u) / q(u)] = integral of f.
    u = space.to_unit(theta)
    weight = torch.exp(-mixture.log_prob_frame(u))
    for column in range(len(space)):
        sums = [float((weight * (u[:, column] < level)).mean()) for level in (0.25, 0.5, 0.75)]
        assert torch.tensor(sums).allclose(torch.tensor([0.25, 0.5, 0.75]), atol=0.08)


@pytest.mark.parametrize("space", [ONE, TWO, THREE])
@pytest.mark.parametrize("mean", [-0.2, 1.25, 30.0])
def test_a_component_far_outside_still_gives_samples_inside(space: ParameterSpace, mean: float) -> None:
    size = len(space)
    lower = 0.02 * (torch.eye(size) + 0.9 * torch.ones(size, size).tril(-1)).double()
    mixture = TruncatedMixture(
        torch.zeros(1).double(), torch.full((1, size), mean).double(), lower[None], Box.whole(space)
    )
    theta = mixture.sample((500,))
    assert space.contains(theta).all()
    assert torch.isfinite(mixture.log_prob(theta)).all()
    assert len(theta.unique(dim=0)) > 400


def test_the_fallback_draws_from_the_truncated_gaussian() -> None:
    # Independent coordinates, mean 6 deviations below the box: rejection cannot, the exact marginal is known.
    mixture = TruncatedMixture(
        torch.zeros(1).double(), torch.full((1, 2), -0.6).double(), (0.1 * torch.eye(2)).double()[None], Box.whole(TWO)
    )
    z = mixture.sample_frame((2000,))
    tail = torch.special.ndtr(torch.tensor(-6.0).double())

    def cdf(x: object) -> object:
        return ((tail - torch.special.ndtr(-(torch.as_tensor(x) + 0.6) / 0.1)) / tail).numpy()

    # Two tests at p > .001: false failures 2 in 1000 seeds; the seed is fixed.
    assert all(kstest(z[:, column].numpy(), cdf).pvalue > 1e-3 for column in range(2))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_no_nan_in_the_tails_and_edges_are_ordinary(dtype: torch.dtype) -> None:
    mean, lower = torch.tensor([[0.5, 0.5]], dtype=dtype), 1e-4 * torch.eye(2, dtype=dtype)[None]
    mixture = TruncatedMixture(
        torch.zeros(1, dtype=dtype), mean.requires_grad_(), lower.requires_grad_(), Box.whole(TWO)
    )
    corners = TWO.from_unit(torch.tensor([[0, 0], [0, 1], [1, 0], [1, 1]]).double())
    log_prob = mixture.log_prob(corners)
    assert torch.isfinite(log_prob).all()
    assert (log_prob < -1e6).all()
    log_prob.sum().backward()
    assert torch.isfinite(mean.grad).all()  # type: ignore[arg-type]
    assert torch.isfinite(lower.grad).all()  # type: ignore[arg-type]
    assert mixture.log_prob(TWO.from_unit(torch.tensor([1.0 + 1e-6, 0.5]).double())) == -math.inf


def test_a_truth_on_the_edge_is_as_likely_as_its_neighbours() -> None:
    mixture = TruncatedMixture(
        torch.zeros(1).double(),
        torch.ones(1, 1).double(),
        torch.full((1, 1, 1), 0.1, dtype=torch.float64),
        Box.whole(ONE),
    )
    edge, near = mixture.log_prob(torch.tensor([[3.0], [2.999]]).double())
    assert float(edge) == pytest.approx(math.log(2 * 0.3989422804 / 0.1 / 5), abs=1e-9)
    assert float(edge - near) == pytest.approx(0, abs=1e-4)


def test_log_scale_density_counts_on_the_original_scale() -> None:
    space = ParameterSpace({"b": Parameter(0.01, 100.0, "kg", "log")})
    density = BoxUniform(space).log_prob(torch.tensor([[0.1], [10.0]]).double())
    torch.testing.assert_close(density, -torch.log(torch.tensor([0.1, 10.0]).double() * math.log(1e4)))


def test_batches_broadcast_and_equal_single_mixtures() -> None:
    singles = [_mixture(TWO) for _ in range(4)]
    batch = TruncatedMixture(
        torch.stack([m.log_weights for m in singles]),
        torch.stack([m.mean for m in singles]),
        torch.stack([m.scale_tril for m in singles]),
        Box.whole(TWO),
    )
    theta = BoxUniform(TWO).sample((7, 4))
    together = batch.log_prob(theta)
    assert together.shape == (7, 4)
    for i, single in enumerate(singles):
        torch.testing.assert_close(together[:, i], single.log_prob(theta[:, i]))
    assert batch.sample((5, 3)).shape == (5, 3, 4, 2)
    assert batch.sample().shape == (4, 2)
    assert TWO.contains(batch.sample((100,))).all()


def test_sampling_is_repeatable_by_its_generator() -> None:
    mixture = _mixture(TWO)
    one, other = (mixture.sample((50,), torch.Generator().manual_seed(3)) for _ in range(2))
    assert torch.equal(one, other)


def test_a_belief_about_nothing_has_empty_draws_and_is_certain() -> None:
    """Of a model in which no parameter is free."""
    nothing = TruncatedMixture(torch.zeros(1), torch.zeros(1, 0), torch.zeros(1, 0, 0), Box.whole(ParameterSpace({})))
    assert nothing.sample((2,)).shape == (2, 0)
    assert nothing.log_prob(torch.zeros(2, 0)).tolist() == [0.0, 0.0]


def test_a_box_checks_its_sides_and_gives_its_cross() -> None:
    with pytest.raises(ValueError, match="needs 0 <= low < high <= 1"):
        Box(ONE, torch.tensor([0.5]).double(), torch.tensor([0.5]).double())
    box = Box(ONE, torch.tensor([0.2]).double(), torch.tensor([0.6]).double())
    torch.testing.assert_close(box.cross(1.0), torch.tensor([[0.0], [1.0], [-1.0]]).double())
    assert box.log_volume == pytest.approx(math.log(0.4))
    theta = torch.tensor([[-0.7], [0.3]]).double()
    torch.testing.assert_close(box.from_frame(box.to_frame(theta)), theta)


@pytest.mark.gpu
def test_on_a_gpu_it_gives_the_same() -> None:
    mixture, theta = _mixture(THREE), BoxUniform(THREE).sample((50,))
    moved = TruncatedMixture(mixture.log_weights.cuda(), mixture.mean.cuda(), mixture.scale_tril.cuda(), mixture.box)
    torch.testing.assert_close(moved.log_prob(theta.cuda()).cpu(), mixture.log_prob(theta))
    assert moved.sample((10,)).device.type == "cuda"


# A sixth of the mixture lies outside, or nearly all of it.
@pytest.mark.parametrize(("mean", "count"), [(0.1, 200_000), (-0.3, 10_000)])
def test_many_draws_and_densities_are_those_of_few(mean: float, count: int) -> None:
    mixture = TruncatedMixture(
        torch.tensor([0.3, 0.7]).double().log(),
        torch.tensor([[mean, 0.5], [mean, 0.6]]).double(),
        0.1 * torch.tensor([[[1.0, 0.0], [0.5, 1.0]], [[1.0, 0.0], [0.0, 0.3]]]).double(),
        Box.whole(TWO),
    )
    theta = mixture.sample((count,))
    pieces = torch.cat([mixture.log_prob(rows) for rows in theta.split(999)])
    torch.testing.assert_close(mixture.log_prob(theta), pieces)
    # The mean of 1 / q over the draws in a cell is the cell's volume: within 5 standard errors, seed fixed.
    z = TWO.to_unit(theta)
    weight = torch.exp(-mixture.log_prob_frame(z))
    for level in (0.02, 0.05):
        cell = weight * ((z[:, 0] < level) & ((z[:, 1] - 0.58).abs() < 0.02))
        assert abs(float(cell.mean()) - level * 0.04) < 5 * float(cell.std()) / count**0.5
        assert float(cell.std()) / count**0.5 < 0.1 * level * 0.04, "too few to tell"
