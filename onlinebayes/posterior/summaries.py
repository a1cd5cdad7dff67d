"""Weighted draws of theta, and replays at them, as the numbers that a report shows."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification import Windows
from onlinebayes.inference import Identifiability
from onlinebayes.inference.distributions.kernels import moments
from onlinebayes.parameters import ParameterSpace
from onlinebayes.posterior.results import ParameterBelief, Reproduction
from onlinebayes.posterior.score import Score

LEVELS = (0.05, 0.5, 0.95)
"""Of the quantiles that are told."""


def each_parameter(
    theta: Float[Tensor, "N P"],
    weight: Float[Tensor, " N"],
    fitted: Float[Tensor, " P"],
    found: Identifiability,
    space: ParameterSpace,
) -> dict[str, ParameterBelief]:
    """Of each parameter.

    Args:
        theta, weight: draws of the posterior [SI], and weights of sum 1.
        fitted: by least squares [SI].
        found: how wide each is beside its prior.
        space: the parameters.
    """
    mean, covariance = moments(theta, weight)
    columns = (
        mean,
        covariance.diagonal().sqrt(),
        *quantiles(theta, weight, LEVELS),
        theta.new_tensor([found.parameters[name] for name in space.names]),
        fitted,
    )
    rows = torch.stack([column.to(theta) for column in columns]).T.tolist()
    return {
        name: ParameterBelief(mid, sd, q05, q50, q95, space[name].unit, share, by_least_squares)
        for name, (mid, sd, q05, q50, q95, share, by_least_squares) in zip(space, rows, strict=True)
    }


def quantiles(
    values: Float[Tensor, "N C"], weight: Float[Tensor, " N"], levels: tuple[float, ...]
) -> Float[Tensor, "Q C"]:
    """Weighted quantiles of each column: the least value up to which so much weight lies."""
    ordered, order = values.sort(0)
    reached = weight[order].cumsum(0)
    at = [(reached < level).sum(0).clamp_max(len(values) - 1) for level in levels]
    return torch.stack([ordered.gather(0, one[None])[0] for one in at])


def correlation(theta: Float[Tensor, "N P"], weight: Float[Tensor, " N"]) -> Float[Tensor, "P P"]:
    """Between the parameters."""
    _, covariance = moments(theta, weight)
    sd = covariance.diagonal().sqrt().clamp_min(1e-300)
    return (covariance / (sd[:, None] * sd)).clamp(-1, 1)


def mean_squares(score: Score, rows: Float[Tensor, "N W m"]) -> Float[Tensor, "N S"]:
    """Of what replays miss of each signal, over all bins that hold an observation [SI]."""
    windows = score.windows
    left = score.fitted.rows.in_noise(rows) * windows.bin_noise
    squares = torch.where(windows.seen, left, torch.zeros_like(left)).square().sum((1, 2))
    return squares / windows.seen.sum((0, 1)).clamp_min(1)


def reproductions(
    windows: Windows, squares: Float[Tensor, "N S"], weight: Float[Tensor, " N"], units: Mapping[str, str]
) -> dict[str, Reproduction]:
    """Measure the error with which the posterior's worlds follow each signal; empty where none could be followed.

    Args:
        windows: that were replayed.
        squares: :func:`mean_squares` of every draw.
        weight: of the draws.
        units: signal -> unit, in the order of the columns.
    """
    if not len(weight):
        return {}
    noise = torch.where(windows.seen, windows.bin_noise, torch.zeros_like(windows.bin_noise)).square().sum((0, 1))
    noise = (noise / windows.seen.sum((0, 1)).clamp_min(1)).sqrt()
    low, mid, high = quantiles(squares.sqrt(), weight.to(squares), LEVELS)
    return {
        signal: Reproduction(float(mid[s]), float(low[s]), float(high[s]), float(noise[s]), unit)
        for s, (signal, unit) in enumerate(units.items())
    }
