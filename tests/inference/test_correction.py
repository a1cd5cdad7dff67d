"""The posterior under the prior from a density learnt under a Gaussian proposal, against sums on a grid."""

from __future__ import annotations

import math

import pytest
import torch

from onlinebayes.inference import Box, BoxUniform, TruncatedMixture, Uncorrectable, corrected, proposals
from onlinebayes.parameters import ParameterSpace
from tests.inference.test_distributions import ONE, THREE, TWO, _grid


def _gaussian(mean: list[float], sd: float, shear: float, space: ParameterSpace) -> TruncatedMixture:
    size = len(space)
    lower = sd * torch.eye(size).double() + shear * torch.ones(size, size).double().tril(-1)
    return TruncatedMixture(torch.zeros(1).double(), torch.tensor([mean]).double(), lower[None], Box.whole(space))


def _learnt(space: ParameterSpace, sd: float = 0.1, box: Box | None = None) -> TruncatedMixture:
    """Three components, each narrower than ``sd`` * 1.5 in every direction; one of them outside the box."""
    size = len(space)
    generator = torch.Generator().manual_seed(3)
    spread = torch.randn(3, size, size, dtype=torch.float64, generator=generator)
    lower = torch.linalg.cholesky(spread @ spread.mT + 0.2 * torch.eye(size).double())
    lower = (
        sd * lower / torch.linalg.matrix_norm(lower, 2)[:, None, None] * torch.tensor([0.7, 1.0, 1.4])[:, None, None]
    )
    mean = torch.linspace(0.2, 1.05, 3 * size).double().reshape(3, size)
    return TruncatedMixture(torch.tensor([0.5, -1.0, 0.2]).double(), mean, lower, box or Box.whole(space))


def _divided_on_a_grid(
    density: TruncatedMixture, proposal: TruncatedMixture, count: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Points, and log of q p / p~ there, normalised by its sum."""
    points, volumes = _grid(density.space, count)
    log_u = density.log_prob(points) - proposal.log_prob(points)  # p is uniform in u: the Jacobians cancel
    log_prob = torch.where(density.box.contains(points), log_u + density.space.log_abs_det(points), -torch.inf)
    return points, log_prob - torch.logsumexp(log_prob + torch.log(volumes), 0)


@pytest.mark.parametrize(("space", "count", "tolerance"), [(ONE, 4000, 1e-5), (TWO, 400, 3e-3)])
def test_the_correction_is_exact_on_gaussians(space: ParameterSpace, count: int, tolerance: float) -> None:
    """Three components, one proposal, edges of the box included.

    Eq 4.17 as printed, with S_k^-1 in place of S'_k outside, fails this test: it moves the means by hundreds of boxes
    (``test_the_printed_mean_is_wrong``).
    """
    proposal = _gaussian([0.6, 0.3][: len(space)], 0.25, 0.1, space)
    density = _learnt(space)
    result = corrected(density, proposal)
    assert isinstance(result, TruncatedMixture)
    points, exact = _divided_on_a_grid(density, proposal, count)
    heavy = exact > exact.max() - 20
    assert float((result.log_prob(points) - exact)[heavy].abs().max()) < tolerance


def test_the_correction_is_exact_on_a_part_of_the_box() -> None:
    box = Box(TWO, torch.tensor([0.3, 0.2]).double(), torch.tensor([0.9, 0.7]).double())
    density, proposal = _learnt(TWO, box=box), _gaussian([0.6, 0.3], 0.2, 0.1, TWO)
    result = corrected(density, proposal)
    assert isinstance(result, TruncatedMixture)
    points, exact = _divided_on_a_grid(density, proposal, 500)
    heavy = exact > exact.max() - 20
    assert float((result.log_prob(points) - exact)[heavy].abs().max()) < 0.01


def test_the_printed_mean_is_wrong() -> None:
    """Equations 4.16 and 4.17 by inverses: with S'_k outside they agree with the code, as printed they do not."""
    density, proposal = _learnt(TWO), _gaussian([0.6, 0.3], 0.25, 0.1, TWO)
    result = corrected(density, proposal)
    assert isinstance(result, TruncatedMixture)
    precision, first = (torch.cholesky_inverse(m.scale_tril) for m in (density, proposal))
    pull = (precision @ density.mean[..., None] - first @ proposal.mean[..., None]).squeeze(-1)
    covariance = torch.linalg.inv(precision - first)
    torch.testing.assert_close(result.scale_tril @ result.scale_tril.mT, covariance)
    torch.testing.assert_close(result.mean, (covariance @ pull[..., None]).squeeze(-1))
    printed = (precision @ pull[..., None]).squeeze(-1)
    assert float((printed - result.mean).abs().max()) > 100


def test_a_component_wider_than_the_proposal_is_named() -> None:
    density, proposal = _learnt(TWO), _gaussian([0.6, 0.3], 0.12, 0.0, TWO)
    result = corrected(density, proposal)
    assert isinstance(result, Uncorrectable)
    assert result.component == (2,)
    assert result.ratio == pytest.approx((0.14 / 0.12) ** 2)
    assert "component 2 has 1.36 times the proposal's variance" in result.reason


@pytest.mark.parametrize("gap", [1e-3, 1e-5])
def test_next_to_where_it_ends_the_correction_is_finite_and_right(gap: float) -> None:
    """Almost flat in one direction: numbers of 1 / gap cancel."""
    proposal = _gaussian([0.5, 0.5], 0.1, 0.0, TWO)
    lower = torch.diag(torch.tensor([0.1 * math.sqrt(1 - gap), 0.05]).double())
    density = TruncatedMixture(torch.zeros(1).double(), torch.tensor([[0.52, 0.5]]).double(), lower[None], proposal.box)
    result = corrected(density, proposal)
    assert isinstance(result, TruncatedMixture)
    points, exact = _divided_on_a_grid(density, proposal, 400)
    heavy = exact > exact.max() - 10
    assert float((result.log_prob(points) - exact)[heavy].abs().max()) < 0.01


def test_a_proposal_that_is_the_prior_on_a_region_needs_no_correction() -> None:
    density = _learnt(TWO)
    region = proposals.truncated(density, generator=torch.Generator().manual_seed(0))
    theta = BoxUniform(TWO).sample((50,))
    for flat in (BoxUniform(TWO), region):
        result = corrected(density, flat)
        assert isinstance(result, TruncatedMixture)
        assert torch.equal(result.log_prob(theta), density.log_prob(theta))


def test_a_proposal_that_is_a_mixture_has_no_quotient() -> None:
    result = corrected(_learnt(TWO), _learnt(TWO, 1.0))
    assert isinstance(result, Uncorrectable)
    assert result.component is None
    assert "the proposal has 3 components" in result.reason


def test_a_batch_is_its_rows() -> None:
    proposal = _gaussian([0.6, 0.3, 0.5], 0.2, 0.05, THREE)
    rows = [_learnt(THREE), _learnt(THREE, 0.05)]
    batch = TruncatedMixture(
        *(torch.stack([getattr(row, name) for row in rows]) for name in ("log_weights", "mean", "scale_tril")),
        proposal.box,
    )
    together = corrected(batch, proposal)
    assert isinstance(together, TruncatedMixture)
    theta = BoxUniform(THREE).sample((20,))
    for index, row in enumerate(rows):
        alone = corrected(row, proposal)
        assert isinstance(alone, TruncatedMixture)
        torch.testing.assert_close(together[index].log_prob(theta), alone.log_prob(theta))
    refused = corrected(batch, _gaussian([0.6, 0.3, 0.5], 0.1, 0.0, THREE))
    assert isinstance(refused, Uncorrectable)
    assert refused.component == (0, 2)


def test_a_density_beyond_its_proposal_is_refused() -> None:
    small = Box(TWO, torch.tensor([0.3, 0.2]).double(), torch.tensor([0.9, 0.7]).double())
    whole = _gaussian([0.5, 0.5], 0.3, 0.0, TWO)
    inside = TruncatedMixture(whole.log_weights, whole.mean, whole.scale_tril, small)
    with pytest.raises(ValueError, match="whose box holds the density's"):
        corrected(_learnt(TWO), inside)
