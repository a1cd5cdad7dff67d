"""Calibration in two sentences: what coverage, ranks and balls say of a posterior together.

    alpha, beta, (rank + 1/2) / (S + 1) of each parameter    uniform on [0, 1] for an exact posterior, see calibration

Each is compared with the uniform distribution by the Kolmogorov-Smirnov test. With P parameters there are P + 2 of
them, so that P + 2 times the smallest p is taken (Bonferroni): of exact posteriors one in twenty is doubted at 5 %.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from scipy.stats import kstest
from tensordict import TensorDictBase
from torch import Tensor

from onlinebayes.inference.calibration import PosteriorFor, ball_credibility, credibility_of
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput

DOUBTED = 0.05
"""p, of all tests together, below which a posterior is not taken for calibrated."""

FEWEST = 20
"""Pairs: the standard error of the share in a 50 % region is a tenth then."""

LEVELS = (0.5, 0.95)
"""Of the regions that are told."""


def in_words(
    posterior_for: PosteriorFor,
    thetas: Float[Tensor, "B P"],
    trajectories: TensorDictBase,
    space: ParameterSpace,
    *,
    samples: int = 999,
    generator: torch.Generator | None = None,
) -> str:
    """Two sentences: how often regions hold the truth, and what ranks and balls about random points say.

    Args:
        posterior_for: see :data:`~onlinebayes.inference.calibration.PosteriorFor`.
        thetas: true parameters (B, P) [units], drawn from the prior, B >= 20.
        trajectories: the trajectory of each (B, T).
        space: the parameters.
        samples: draws from each posterior.
        generator: for those draws.

    Raises:
        BadInput: fewer pairs.
    """
    if len(thetas) < FEWEST:
        raise BadInput(f"{len(thetas)} pairs of theta and trajectory", f"coverage needs {FEWEST} or more")
    posterior = posterior_for(trajectories)
    alpha = credibility_of(posterior, thetas, samples=samples, generator=generator).cpu()
    beta = ball_credibility(posterior, thetas, space, samples=samples, generator=generator).cpu()
    draws = posterior.sample((samples,), generator)
    ranks = (((draws < thetas.to(draws)).sum(0) + 0.5) / (samples + 1)).double().cpu()
    others = {name: ranks[:, i] for i, name in enumerate(space)}
    return f"{_coverage(alpha, len(others) + 2)} {_others(beta, others)}"


def _coverage(alpha: Float[Tensor, " B"], tests: int) -> str:
    half, most = ((alpha <= level).double().mean().item() for level in LEVELS)
    said = (
        f"The {100 * LEVELS[0]:g} % region holds {round(half * len(alpha))} of {len(alpha)} truths"
        f" and the {100 * LEVELS[1]:g} % region {round(most * len(alpha))}"
    )
    p = _p(alpha, tests)
    if p >= DOUBTED:
        return f"{said}: as many as it should."
    if half < LEVELS[0] and most < LEVELS[1]:
        return f"{said}: too few, the posterior is too sure (p = {p:.1g})."
    if half >= LEVELS[0] and most >= LEVELS[1]:
        return f"{said}: too many, the posterior is wider than it need be (p = {p:.1g})."
    return f"{said}: other shares than it says (p = {p:.1g})."


def _others(beta: Float[Tensor, " B"], ranks: dict[str, Float[Tensor, " B"]]) -> str:
    tests = len(ranks) + 2
    p = {name: _p(values, tests) for name, values in ranks.items()}
    balls = _p(beta, tests)
    wrong = [f"{name} {_lean(ranks[name])} (p = {p[name]:.1g})" for name in ranks if p[name] < DOUBTED]
    if balls < DOUBTED:
        wrong.append(f"balls about random points hold other shares of truths than they say (p = {balls:.1g})")
    if wrong:
        return f"Of the other checks, {len(wrong)} of {len(ranks) + 1} fail: {', '.join(wrong)}."
    smallest = min(balls, *p.values())
    return (
        f"Ranks of {', '.join(ranks)} and balls about random points show nothing wrong (smallest p = {smallest:.1g})."
    )


def _lean(ranks: Float[Tensor, " B"]) -> str:
    """Describe the error of a parameter's posterior whose ranks are not uniform."""
    off = float(ranks.mean()) - 0.5
    if abs(off) > 2 / math.sqrt(12 * len(ranks)):
        return "lies too low" if off > 0 else "lies too high"
    return "is too narrow" if float(ranks.var()) > 1 / 12 else "is too wide"


def _p(values: Float[Tensor, " B"], tests: int) -> float:
    """Of being uniform, all tests considered."""
    return min(1.0, tests * float(kstest(values.numpy(), "uniform").pvalue))
