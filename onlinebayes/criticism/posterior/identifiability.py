"""What a posterior leaves open, in words: parameters as wide as their prior, and what is known of them together.

A parameter is **open** where its sd is more than half the prior's. Of those, one that the others determine (its sd
given them is less than half its sd) is known **in combination**; another is not known at all. Where all of these are
positive they are written as powers of that one, r, which goes best with the others:

    theta_i / theta_r^b,       b = cov(log theta_i, log theta_r) / var(log theta_r),      to a half where it is near one
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.posterior.results import Combination
from onlinebayes.inference.distributions.kernels import moments
from onlinebayes.parameters import ParameterSpace

OPEN = 0.5
"""Of the prior's sd."""

DETERMINED = 0.5
"""Of a parameter's sd, which is left when the others are known."""

ROUNDED = 0.1
"""By which an exponent may differ from a half or whole number."""


def of_prior(space: ParameterSpace, theta: Float[Tensor, "N P"], weight: Float[Tensor, " N"]) -> Float[Tensor, " P"]:
    """Sd of each parameter as a share of its prior's, in the unit cube's coordinates."""
    _, covariance = moments(space.to_unit(theta), weight)
    return (12 * covariance.diagonal()).sqrt()


def left_open(
    space: ParameterSpace, theta: Float[Tensor, "N P"], weight: Float[Tensor, " N"]
) -> tuple[tuple[str, ...], tuple[Combination, ...]]:
    """Names of parameters of which nothing is known, and the combinations that are.

    Args:
        space: bounds of the prior.
        theta, weight: weighted draws of the posterior [SI].
    """
    shares = of_prior(space, theta, weight)
    wide = [i for i in range(len(space)) if float(shares[i]) > OPEN]
    if not wide:
        return (), ()
    together = _determined(space.to_unit(theta)[:, wide], weight)
    if bool((theta[:, wide] > 0).all()):  # a product of powers is a line among logarithms
        together = [a or b for a, b in zip(together, _determined(theta[:, wide].log(), weight), strict=True)]
    tied = [i for i, known in zip(wide, together, strict=True) if known]
    alone = tuple(space.names[i] for i in wide if i not in tied)
    if len(tied) < 2:
        return tuple(space.names[i] for i in wide), ()
    return alone, _combinations(space, theta, weight, tied)


def _determined(values: Float[Tensor, "N O"], weight: Float[Tensor, " N"]) -> list[bool]:
    """Which of some parameters the others determine."""
    _, covariance = moments(values, weight)
    sd = covariance.diagonal().sqrt()
    correlation = covariance / (sd[:, None] * sd) + 1e-12 * torch.eye(len(sd)).to(sd)
    left = torch.linalg.inv(correlation).diagonal().clamp_min(1).rsqrt()
    return [float(one) < DETERMINED for one in left]


def _combinations(
    space: ParameterSpace, theta: Float[Tensor, "N P"], weight: Float[Tensor, " N"], tied: list[int]
) -> tuple[Combination, ...]:
    """Each parameter with the one that goes best with all; those together that no power of it determines."""
    names, values = [space.names[i] for i in tied], theta[:, tied]
    if not bool((values > 0).all()):
        return (Combination(tuple(names), "", None),)
    _, covariance = moments(values.log(), weight)
    sd = covariance.diagonal().sqrt()
    r = int((covariance / (sd[:, None] * sd)).square().sum(0).argmax())
    pairs, left = list[Combination](), [names[r]]
    for i, name in enumerate(names):
        if i == r:
            continue
        b = float(covariance[i, r] / covariance[r, r])
        half = round(2 * b) / 2
        b = half if half and abs(b - half) < ROUNDED else b
        known = float((covariance[i, i] - 2 * b * covariance[i, r] + b * b * covariance[r, r]).clamp_min(0).sqrt())
        if known < DETERMINED * float(sd[i]):
            pairs.append(Combination((name, names[r]), _written(name, names[r], b), known))
        else:
            left.append(name)
    return (*pairs, Combination(tuple(left), "", None)) if len(left) > 1 else tuple(pairs)


def _written(name: str, other: str, b: float) -> str:
    """``body.bob.mass / joint.hinge.armature^2``."""
    power = other if abs(b) == 1 else f"{other}^{abs(b):.2g}"
    return f"{name} {'/' if b > 0 else '*'} {power}"
