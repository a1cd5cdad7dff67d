"""Mixtures made of mixtures, and marginals, against sums on a grid."""

from __future__ import annotations

import pytest
import torch

from onlinebayes.inference import Box, BoxUniform, TruncatedMixture
from onlinebayes.inference.distributions.algebra import in_box, product, union, widened
from onlinebayes.inference.distributions.marginal import Marginal
from onlinebayes.parameters import Parameter, ParameterSpace
from tests.inference.test_distributions import THREE, TWO, _grid, _mixture


def test_union_is_the_mean_of_the_densities() -> None:
    mixtures = [_mixture(TWO) for _ in range(3)]
    theta = BoxUniform(TWO).sample((50,))
    mean = torch.stack([m.log_prob(theta) for m in mixtures]).logsumexp(0) - torch.log(torch.tensor(3.0).double())
    torch.testing.assert_close(union(mixtures).log_prob(theta), mean, rtol=1e-6, atol=1e-6)


def test_product_is_the_normalised_product_of_the_densities() -> None:
    mixtures = [_mixture(TWO) for _ in range(3)]
    points, volumes = _grid(TWO, 200)
    # Under a uniform prior on u the factors multiply as densities of u.
    log_u = sum((m.log_prob(points) - TWO.log_abs_det(points) for m in mixtures), torch.zeros(len(points)).double())
    unnormalised = log_u + TWO.log_abs_det(points)
    exact = unnormalised - torch.logsumexp(unnormalised + torch.log(volumes), 0)
    ours = product(mixtures).log_prob(points)
    heavy = exact > exact.max() - 10
    assert (ours - exact)[heavy].abs().max() < 0.01


def test_product_keeps_the_heaviest_components_only() -> None:
    mixtures = [_mixture(TWO, components=6) for _ in range(4)]
    assert product(mixtures, keep=20).log_weights.shape == (20,)
    theta = product(mixtures).sample((500,))
    gap = product(mixtures, keep=20).log_prob(theta) - product(mixtures, keep=10_000).log_prob(theta)
    assert gap.abs().median() < 0.05


def test_one_mixture_is_its_own_union_and_product() -> None:
    mixture, theta = _mixture(THREE), BoxUniform(THREE).sample((20,))
    for combined in (union([mixture]), product([mixture])):
        torch.testing.assert_close(combined.log_prob(theta), mixture.log_prob(theta))


def test_another_box_keeps_the_shape_and_renormalises() -> None:
    small = Box(TWO, torch.tensor([0.3, 0.2]).double(), torch.tensor([0.9, 0.5]).double())
    mixture = _mixture(TWO)
    moved = in_box(mixture, small)
    theta = BoxUniform(TWO, small).sample((50,))
    difference = moved.log_prob(theta) - mixture.log_prob(theta)
    assert difference.std() < 1e-9
    assert difference.mean() > 0
    torch.testing.assert_close(in_box(moved, Box.whole(TWO)).log_prob(theta), mixture.log_prob(theta))


def test_widening_scales_the_deviations() -> None:
    narrow = TruncatedMixture(
        torch.zeros(1).double(), torch.full((1, 2), 0.5).double(), 0.01 * torch.eye(2).double()[None], Box.whole(TWO)
    )
    ratio = widened(narrow, 3.0).sample_frame((5000,)).std(0) / narrow.sample_frame((5000,)).std(0)
    torch.testing.assert_close(ratio, torch.full((2,), 3.0).double(), rtol=0.05, atol=0)


def test_boxes_must_be_shared() -> None:
    small = Box(TWO, torch.tensor([0.3, 0.2]).double(), torch.tensor([0.9, 0.5]).double())
    with pytest.raises(ValueError, match="different boxes"):
        union([_mixture(TWO), _mixture(TWO, box=small)])
    with pytest.raises(ValueError, match="at least one"):
        product([])


@pytest.mark.parametrize("names", [["a"], ["b"], ["b", "a"], ["c", "a"], ["a", "b", "c"]])
def test_marginals_against_sums_on_a_grid(names: list[str]) -> None:
    mixture = _mixture(THREE, spread=0.5)
    count = 48
    points, volumes = _grid(THREE, count)
    mass = (mixture.log_prob(points).exp() * volumes).reshape(count, count, count)
    axes = [THREE.index(name) for name in names]
    others = [i for i in range(3) if i not in axes]
    summed = mass.sum(others) if others else mass
    order = sorted(axes)
    summed = summed.permute([order.index(axis) for axis in axes])
    sub, widths = _grid(THREE.subspace(names), count)
    ours = (Marginal(mixture, names).log_prob(sub).exp() * widths).reshape(summed.shape)
    assert (ours - summed).abs().sum() < 0.03  # total variation; the cells' midpoints cost most of it


def test_marginal_samples_and_outside() -> None:
    mixture = _mixture(TWO)
    marginal = Marginal(mixture, ["b"])
    samples = marginal.sample((100,))
    assert samples.shape == (100, 1)
    assert marginal.space.names == ("b",)
    assert ((samples >= 0.01) & (samples <= 10)).all()
    assert torch.isinf(marginal.log_prob(torch.tensor([[11.0]]).double())).all()
    flat = Marginal(BoxUniform(TWO), ["a"])
    torch.testing.assert_close(flat.log_prob(torch.tensor([[0.5]]).double()), -torch.log(torch.tensor([5.0]).double()))


def test_one_parameter_of_one() -> None:
    space = ParameterSpace({"x": Parameter(0.0, 2.0)})
    mixture = _mixture(space)
    theta = BoxUniform(space).sample((9,))
    torch.testing.assert_close(Marginal(mixture, ["x"]).log_prob(theta), mixture.log_prob(theta))
