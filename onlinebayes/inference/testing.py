"""Conformance checks for posterior estimators, for the tests of those you write yourself.

    check_estimator(lambda: MyEstimator(space), simulate, BoxUniform(space))

| check     | what it asks                                                                             |
|-----------|------------------------------------------------------------------------------------------|
| learns    | after a fit the truth is denser than under the prior, on trajectories it has not seen    |
| density   | gives a box as much as lies in it of the draws, zero outside the bounds, finite inside    |
| draws     | lie in the box, have the asked-for shape, and repeat with a generator's seed             |
| each      | groups as one batch give what ``condition`` gives one by one                             |
| leaves    | conditioning changes neither the estimator nor an earlier belief                         |
"""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.inference.base import Belief, PosteriorEstimator
from onlinebayes.inference.distributions import BoxUniform

Simulate = Callable[[Tensor, torch.Generator], TensorDict]
"""(theta (B, P), generator) -> trajectories (B, T) with their theta."""


def check_estimator(
    make: Callable[[], PosteriorEstimator], simulate: Simulate, prior: BoxUniform, *, simulations: int = 400
) -> None:
    """Run every check.

    Args:
        make: a fresh estimator over the prior's box.
        simulate: see :data:`Simulate`; what theta does must show in the trajectories.
        prior: where theta is drawn.
        simulations: for the fit.

    Raises:
        AssertionError: of the first check that fails.
    """
    generator = torch.Generator().manual_seed(0)
    estimator = make()
    assert isinstance(estimator, PosteriorEstimator), f"{type(estimator).__name__} lacks a member of the protocol"
    theta = prior.sample((simulations,), generator)
    held = prior.sample((20,), generator)
    groups = torch.stack([simulate(held, generator) for _ in range(2)], dim=1)
    estimator.fit(simulate(theta, generator), groups, generator=generator)
    fresh = prior.sample((40,), generator)
    pairs = torch.stack([simulate(fresh, generator) for _ in range(2)], dim=1)
    _check_learns(estimator, pairs, fresh, prior)
    measured = cast(TensorDict, pairs).exclude("theta")
    _check_density(estimator, cast(TensorDict, measured[0]), prior)
    _check_each(estimator, cast(TensorDict, measured[:3]), prior)


def _check_learns(estimator: PosteriorEstimator, pairs: TensorDict, theta: Tensor, prior: BoxUniform) -> None:
    gain = estimator.each(pairs).log_prob(theta) - prior.log_prob(theta)
    assert gain.shape == theta.shape[:1], f"log_prob of {len(theta)} posteriors has shape {tuple(gain.shape)}"
    assert gain.mean() > 0.1, f"the truth gains {float(gain.mean()):.2f} nats over the prior"


def _check_density(estimator: PosteriorEstimator, trajectories: TensorDict, prior: BoxUniform) -> None:
    belief = estimator.condition(trajectories)
    draws = belief.sample((300,), torch.Generator().manual_seed(1))
    assert draws.shape == (300, len(prior.space)), f"300 draws have shape {tuple(draws.shape)}"
    assert bool(estimator.box.contains(draws).all()), "a draw lies outside the box"
    assert torch.equal(draws, belief.sample((300,), torch.Generator().manual_seed(1))), "a seed does not repeat draws"
    assert bool(torch.isfinite(belief.log_prob(draws)).all()), "the density is not finite where it draws"
    mass, share = _in_the_middle(belief, belief.sample((2000,), torch.Generator().manual_seed(2)), prior)
    assert abs(mass - share) < 0.15, f"the density gives {mass:.2f} to where {share:.2f} of its draws lie"
    outside = prior.space.high + (prior.space.high - prior.space.low)
    assert float(belief.log_prob(outside.double())) == -torch.inf, "the density is not zero outside the bounds"


def _in_the_middle(belief: Belief, draws: Tensor, prior: BoxUniform) -> tuple[float, float]:
    """Mass that the density gives to a parallelepiped around its denser draws, and the share of draws in it."""
    space, box = prior.space, prior.box
    u, density = space.to_unit(draws), belief.log_prob(draws)
    dense = u[density >= density.median()]
    mean, size = dense.mean(0), u.shape[1]
    spread = dense.T.cov().reshape(size, size) + 1e-16 * torch.eye(size).to(u)
    lower = torch.linalg.cholesky(spread)
    w = 4 * torch.rand(4000, size, dtype=u.dtype, generator=torch.Generator().manual_seed(3)).to(u) - 2
    points = mean + w @ lower.T
    inside = ((points >= 0) & (points <= 1)).all(-1)
    points = space.from_unit(points.clamp(0, 1))
    value = (belief.log_prob(points) - space.log_abs_det(points)).exp() * inside
    volume = 4.0**size * float(torch.linalg.det(lower))
    standard = torch.linalg.solve_triangular(lower, (u - mean).T, upper=False)
    return volume * float(value[box.contains(points)].sum() / 4000), float((standard.abs() <= 2).all(0).double().mean())


def _check_each(estimator: PosteriorEstimator, groups: TensorDict, prior: BoxUniform) -> None:
    theta = prior.sample((len(groups),), torch.Generator().manual_seed(3))
    first = estimator.condition(groups[0])
    before = first.log_prob(theta)
    single = torch.stack([estimator.condition(group).log_prob(theta[i]) for i, group in enumerate(groups.unbind(0))])
    torch.testing.assert_close(estimator.each(groups).log_prob(theta).double(), single.double(), rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(first.log_prob(theta), before, rtol=0, atol=0)
