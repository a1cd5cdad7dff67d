"""Does a posterior mean what it says? Coverage of highest-density regions, and ranks.

    alpha_i = P_{q_i}( q_i(theta') >= q_i(theta_i) )    credibility of the smallest region that holds the truth
    coverage(level) = share of i with alpha_i <= level   = level for an exact posterior

averaged over theta_i from the prior and x_i from the simulator (Hermans et al. 2022, "A trust crisis in
simulation-based inference"). Below the level: overconfident. The ranks of the truth among posterior draws, parameter
by parameter, are uniform for an exact posterior (simulation-based calibration, Talts et al. 2018).

    beta_i = P_{q_i}( |theta' - r_i| < |theta_i - r_i| )    credibility of the ball about a random point r_i

is uniform, too, and needs draws only (TARP, Lemos, Coogan, Hezaveh and Perreault-Levasseur 2023). A
posterior that is the prior passes all three, unless the reference points depend on the trajectories.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from jaxtyping import Float, Int
from tensordict import TensorDictBase
from torch import Tensor

from onlinebayes.inference.base import Density
from onlinebayes.parameters import ParameterSpace

LEVELS = (0.05, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95)

PosteriorFor = Callable[[TensorDictBase], Density]
"""Trajectories (B, T), each of a theta of its own -> their B posteriors as a batch; ``Posterior.each`` is one."""


def credibility(
    posterior_for: PosteriorFor,
    thetas: Float[Tensor, "B P"],
    trajectories: TensorDictBase,
    *,
    samples: int = 1000,
    generator: torch.Generator | None = None,
) -> Float[Tensor, " B"]:
    """alpha of each pair: the credibility of the highest-density region with the truth on its edge.

    Args:
        posterior_for: see :data:`PosteriorFor`.
        thetas: true parameters (B, P) [units], drawn from the prior.
        trajectories: the trajectory of each (B, T).
        samples: posterior draws by which a region's credibility is found.
        generator: for those draws.
    """
    return credibility_of(posterior_for(trajectories), thetas, samples=samples, generator=generator)


@torch.no_grad()
def credibility_of(
    posterior: Density, thetas: Float[Tensor, "B P"], *, samples: int = 1000, generator: torch.Generator | None = None
) -> Float[Tensor, " B"]:
    """alpha of each pair, for B posteriors as one batch; see :func:`credibility`."""
    draws = posterior.sample((samples,), generator)
    truth = posterior.log_prob(thetas.to(draws.device))
    return (posterior.log_prob(draws) >= truth).double().mean(0)


def coverage(
    posterior_for: PosteriorFor,
    thetas: Float[Tensor, "B P"],
    trajectories: TensorDictBase,
    levels: Sequence[float] = LEVELS,
    *,
    samples: int = 1000,
    generator: torch.Generator | None = None,
) -> Float[Tensor, " L"]:
    """Share of truths inside the highest-density region of each level; equal to the level when calibrated.

    With B test pairs the standard error at a level l is sqrt(l (1 - l) / B): .035 at one half for B = 200.
    Arguments as for :func:`credibility`.
    """
    alpha = credibility(posterior_for, thetas, trajectories, samples=samples, generator=generator)
    level = torch.as_tensor(levels, dtype=alpha.dtype, device=alpha.device)
    return (alpha.unsqueeze(0) <= level.unsqueeze(1)).double().mean(1)


def ranks(
    posterior_for: PosteriorFor,
    thetas: Float[Tensor, "B P"],
    trajectories: TensorDictBase,
    *,
    samples: int = 99,
    generator: torch.Generator | None = None,
) -> Int[Tensor, "B P"]:
    """Count the posterior draws, of ``samples``, that lie below the truth, 0 ... samples, for each parameter.

    Arguments as for :func:`credibility`.
    """
    draws = posterior_for(trajectories).sample((samples,), generator)
    return (draws < thetas.to(draws)).sum(0)


def tarp(
    posterior_for: PosteriorFor,
    thetas: Float[Tensor, "B P"],
    trajectories: TensorDictBase,
    space: ParameterSpace,
    levels: Sequence[float] = LEVELS,
    *,
    references: Float[Tensor, "B P"] | None = None,
    samples: int = 1000,
    generator: torch.Generator | None = None,
) -> Float[Tensor, " L"]:
    """Share of truths inside the ball of each level about a random point; equal to the level when calibrated.

    Args:
        space: the parameters; distances are counted in its unit cube.
        levels: of the balls.
        references: the points [units]; uniform in the space when None. Points that depend on the trajectories (another
            estimator's means, say) also catch a posterior that ignores them.

    The other arguments are those of :func:`credibility`.
    """
    beta = ball_credibility(
        posterior_for(trajectories), thetas, space, references=references, samples=samples, generator=generator
    )
    level = torch.as_tensor(levels, dtype=beta.dtype, device=beta.device)
    return (beta.unsqueeze(0) <= level.unsqueeze(1)).double().mean(1)


@torch.no_grad()
def ball_credibility(
    posterior: Density,
    thetas: Float[Tensor, "B P"],
    space: ParameterSpace,
    *,
    references: Float[Tensor, "B P"] | None = None,
    samples: int = 1000,
    generator: torch.Generator | None = None,
) -> Float[Tensor, " B"]:
    """beta of each pair, for B posteriors as one batch; see :func:`tarp`."""
    draws = space.to_unit(posterior.sample((samples,), generator).double())
    device = draws.device if generator is None else generator.device
    u = torch.rand(draws.shape[1:], dtype=draws.dtype, device=device, generator=generator).to(draws)
    centre = u if references is None else space.to_unit(references.to(draws))
    farther = (space.to_unit(thetas.to(draws)) - centre).norm(dim=-1)
    return ((draws - centre).norm(dim=-1) < farther).double().mean(0)
