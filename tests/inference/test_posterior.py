"""Posterior and proposals: immutable, narrowing without losing anything, bounded work."""

from __future__ import annotations

import io
import math

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.inference import (
    Box,
    BoxUniform,
    MixtureEstimator,
    NeuralPosteriorLoss,
    Posterior,
    TruncatedMixture,
    fit,
    proposals,
    saving,
)
from onlinebayes.inference.proposals import TruncatedProposal
from onlinebayes.parameters import ParameterSpace
from tests.inference.systems import trajectories
from tests.inference.test_distributions import ONE, THREE, TWO
from tests.inference.test_estimator import _data, _loss


def _generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def _posterior(mixture: TruncatedMixture) -> Posterior:
    return Posterior(_loss(mixture.space))._with(mixture)


def _gaussian(
    space: ParameterSpace, mean: list[float], lower: torch.Tensor, box: Box | None = None
) -> TruncatedMixture:
    return TruncatedMixture(
        torch.zeros(1).double(), torch.tensor([mean]).double(), lower.double()[None], box or Box.whole(space)
    )


RIDGE = torch.tensor([[0.2, 0.0], [0.2, 2e-4]])


def test_an_unconditioned_posterior_is_its_box() -> None:
    posterior, theta = Posterior(_loss(TWO)), BoxUniform(TWO).sample((5,))
    torch.testing.assert_close(posterior.log_prob(theta), BoxUniform(TWO).log_prob(theta))
    assert proposals.truncated(posterior, generator=_generator()) is posterior.distribution


def test_conditioning_leaves_the_posterior_and_the_loss_as_they_were() -> None:
    loss, data = _loss(TWO), _data(TWO)
    prior = Posterior(loss)
    first = prior.condition(data[:1])
    theta = BoxUniform(TWO).sample((5,))
    before = first.log_prob(theta)
    second = first.condition(data[1:2])
    fit(loss, data, generator=_generator(), epochs=2)
    torch.testing.assert_close(first.log_prob(theta), before)
    torch.testing.assert_close(second.log_prob(theta), prior.condition(data[1:2]).log_prob(theta))
    assert isinstance(prior.distribution, BoxUniform)
    assert all(weight.requires_grad for weight in loss.parameters())


def test_one_trajectory_gives_the_same_however_it_is_combined() -> None:
    posterior, data, theta = Posterior(_loss(TWO)), _data(TWO)[:1], BoxUniform(TWO).sample((5,))
    one, other = (posterior.condition(data, combine=combine).log_prob(theta) for combine in ("union", "product"))
    torch.testing.assert_close(one, other)
    torch.testing.assert_close(one, posterior.each(data).log_prob(theta.unsqueeze(1))[:, 0], rtol=1e-4, atol=1e-4)
    with pytest.raises(ValueError, match="use 'union' or 'product'"):
        posterior.condition(data, combine="mean")


def test_ragged_trajectories_condition_like_their_cut_selves() -> None:
    posterior, data, theta = Posterior(_loss(TWO)), _data(TWO)[:1].clone(), BoxUniform(TWO).sample((5,))
    cut = posterior.condition(data[:, :3] if data.batch_dims > 1 else _cut(data, 3)).log_prob(theta)
    data["mask"] = torch.tensor([[True, True, True, False]])
    data["observation"][0, 3] = math.nan
    torch.testing.assert_close(posterior.condition(data).log_prob(theta), cut, rtol=1e-4, atol=1e-4)


def _cut(data: TensorDict, steps: int) -> TensorDict:
    return TensorDict(
        {
            "observation": data["observation"][:, :steps],
            "action": data["action"][:, :steps],
            "next": {"observation": data["next", "observation"][:, :steps]},
        },
        batch_size=data.batch_size,
    )


def test_mean_and_quantiles() -> None:
    posterior = _posterior(_gaussian(ONE, [0.4], torch.tensor([[0.05]])))
    torch.testing.assert_close(posterior.mean(), torch.tensor([0.0]).double(), atol=0.01, rtol=0)
    quantiles = posterior.quantiles([0.1587, 0.5, 0.8413])[:, 0]
    torch.testing.assert_close(quantiles, torch.tensor([-0.25, 0.0, 0.25]).double(), atol=0.02, rtol=0)
    assert posterior.marginal(["a"]).log_prob(torch.zeros(1, 1).double()) == pytest.approx(
        math.log(0.39894 / 0.25), abs=1e-4
    )


@pytest.mark.parametrize("lower", [0.1 * torch.eye(2), RIDGE, torch.diag(torch.tensor([3.0, 1e-4]))])
def test_the_region_holds_the_mass_and_its_samples_are_uniform_in_it(lower: torch.Tensor) -> None:
    mixture = _gaussian(TWO, [0.5, 0.3], lower)
    region = proposals.truncated(_posterior(mixture), generator=_generator())
    assert isinstance(region, TruncatedProposal)
    # .997 of the widened posterior: more of the posterior itself. Standard error .0004 at 20000 draws.
    assert region.contains(mixture.sample((20_000,))).double().mean() > 0.997
    theta = region.sample((4000,), _generator(1))
    assert theta.shape == (4000, 2)
    assert region.contains(theta).all()
    assert TWO.contains(theta).all()
    assert region.box.contains(theta).all()
    # Uniform in the region: the density is the same everywhere, and halves of the box hold their share of the volume.
    log_prob = region.log_prob(theta)
    flat = log_prob - TWO.log_abs_det(theta)
    assert flat.std() < 1e-9
    assert region.log_volume <= 0
    reference = torch.rand(400_000, 2, dtype=torch.float64, generator=_generator(2))
    reference = region.box.low + reference * (region.box.high - region.box.low)
    inside = region.contains(TWO.from_unit(reference))
    volume = math.log(float(inside.double().mean())) + region.box.log_volume
    assert region.log_volume == pytest.approx(volume, abs=0.15)
    u, expected = TWO.to_unit(theta), reference[inside]
    torch.testing.assert_close(u.mean(0), expected.mean(0), atol=0.02, rtol=0)
    torch.testing.assert_close(u.std(0), expected.std(0), atol=0.02, rtol=0)


def test_a_ridge_is_followed_where_its_bounding_box_would_not() -> None:
    region = proposals.truncated(_posterior(_gaussian(TWO, [0.5, 0.5], RIDGE)), generator=_generator())
    assert isinstance(region, TruncatedProposal)
    assert region.log_volume < region.box.log_volume - 4


def test_a_union_keeps_both_posteriors() -> None:
    both = TruncatedMixture(
        torch.log(torch.tensor([0.5, 0.5])).double(),
        torch.tensor([[0.2, 0.2], [0.8, 0.7]]).double(),
        torch.stack([0.001 * torch.eye(2), 0.05 * torch.eye(2)]).double(),
        Box.whole(TWO),
    )
    region = proposals.truncated(_posterior(both), generator=_generator())
    centres = TWO.from_unit(torch.tensor([[0.2, 0.2], [0.8, 0.7]]).double())
    assert region.contains(centres).all()  # type: ignore[union-attr]
    assert not region.contains(TWO.from_unit(torch.tensor([0.5, 0.45]).double()))  # type: ignore[union-attr]


@pytest.mark.parametrize("space", [ONE, TWO, THREE])
@pytest.mark.parametrize("scale", [1e-9, 100.0])
def test_nothing_too_narrow_or_too_broad_excludes_everything(space: ParameterSpace, scale: float) -> None:
    size = len(space)
    for mean in (0.0, 0.5, 1.0, 1.2):
        mixture = _gaussian(space, [mean] * size, scale * torch.eye(size))
        region = proposals.truncated(_posterior(mixture), generator=_generator(), samples=2000)
        theta = region.sample((300,), _generator())
        assert space.contains(theta).all()
        assert torch.isfinite(theta).all()
        assert (region.box.low < region.box.high).all()
        if scale > 1:
            assert region.log_volume > -0.2  # type: ignore[union-attr]


def test_a_posterior_that_leans_on_its_box_grows_beyond_it() -> None:
    box = Box(ONE, torch.tensor([0.4]).double(), torch.tensor([0.6]).double())
    mixture = _gaussian(ONE, [1.0], torch.tensor([[0.3]]), box)
    region = proposals.truncated(_posterior(mixture), generator=_generator())
    assert region.box.high == pytest.approx(0.65, abs=0.005)
    assert proposals.truncated(_posterior(mixture), generator=_generator(), growth=0).box.high <= 0.6 + 1e-6
    # On the prior's own side there is nowhere to grow to.
    edge = Box(ONE, torch.tensor([0.8]).double(), torch.tensor([1.0]).double())
    region = proposals.truncated(_posterior(_gaussian(ONE, [1.0], torch.tensor([[0.3]]), edge)), generator=_generator())
    assert region.box.high == 1
    assert ONE.contains(region.sample((500,))).all()


def test_a_region_within_another_is_a_part_of_both() -> None:
    first = proposals.truncated(_posterior(_gaussian(TWO, [0.4, 0.4], RIDGE)), generator=_generator())
    broad = _posterior(_gaussian(TWO, [0.5, 0.5], 0.1 * torch.eye(2)))
    alone = proposals.truncated(broad, generator=_generator())
    both = proposals.truncated(broad, generator=_generator(), within=first)
    assert isinstance(both, TruncatedProposal)
    theta = both.sample((500,), _generator())
    assert alone.contains(theta).all()  # type: ignore[union-attr]
    assert first.contains(theta).all()  # type: ignore[union-attr]
    assert both.log_volume < alone.log_volume - 3  # type: ignore[union-attr]
    apart = proposals.truncated(
        _posterior(_gaussian(TWO, [0.9, 0.1], 1e-3 * torch.eye(2))), generator=_generator(), within=first
    )
    assert TWO.contains(apart.sample((100,), _generator())).all()
    assert not first.contains(apart.sample((100,), _generator())).any()  # type: ignore[union-attr]


def test_a_region_in_a_region_in_a_region_is_saved_without_the_points_of_the_outer_ones() -> None:
    region = None
    for sd in (0.3, 0.2, 0.1):
        belief = _posterior(_gaussian(TWO, [0.5, 0.5], sd * torch.eye(2)))
        region = proposals.truncated(belief, generator=_generator(), within=region)
    state = saving.to_state(region)
    assert len(state["known"]) > 0 == len(state["within"]["known"]) == len(state["within"]["within"]["known"])
    file = io.BytesIO()
    torch.save(state, file)
    assert (
        len(file.getvalue()) < 1.5 * state["known"].untyped_storage().nbytes()
    )  # views would bring their points along
    again = saving.from_state(TWO, state)
    draws = [each.sample((100,), _generator()) for each in (region, again)]
    assert torch.equal(*draws)
    assert region.contains(draws[0]).all()


def test_bad_settings_are_refused() -> None:
    posterior = _posterior(_gaussian(ONE, [0.5], torch.tensor([[0.1]])))
    for mass, dilation, growth in ((0.0, 1.3, 0.2), (1.0, 1.3, 0.2), (0.99, 0.9, 0.2), (0.99, 1.3, -0.1)):
        with pytest.raises(ValueError, match="dilation >= 1"):
            proposals.truncated(posterior, generator=_generator(), mass=mass, dilation=dilation, growth=growth)


def test_rounds_narrow_on_the_truth() -> None:
    """Three rounds on a linear system: the posterior sharpens on the truth by simulating where it still may be."""
    torch.manual_seed(0)
    generator, truth = _generator(3), torch.tensor([[1.0, 0.1]]).double()
    real = trajectories(truth, TWO.to_unit, 0.02, generator).exclude("theta")
    proposal: BoxUniform | TruncatedProposal = BoxUniform(TWO)
    volumes = []
    for _ in range(3):
        loss = _loss(TWO)
        loss = NeuralPosteriorLoss(
            loss.embedding, MixtureEstimator(TWO, loss.embedding.size, hidden=32, box=proposal.box)
        )
        data = trajectories(proposal.sample((500,), generator), TWO.to_unit, 0.02, generator)
        fit(loss, data, generator=generator, epochs=15)
        posterior = Posterior(loss).condition(real)
        proposal = proposals.truncated(posterior, generator=generator)
        assert proposal.contains(truth).all()  # type: ignore[union-attr]
        volumes.append(proposal.log_volume)  # type: ignore[union-attr]
    assert volumes[-1] < -2.5
    assert posterior.log_prob(truth) > BoxUniform(TWO).log_prob(truth) + 3
