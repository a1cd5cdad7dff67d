"""Joint draws of a machine's parameters, from what ``refine`` or ``posterior`` left of it.

    theta ~ sum_k w_k belief_k          k: the models that the log leaves open; cut off at the bounds

A belief is the file that ``posterior`` wrote, where it lies beside refined.toml, else the normal distribution of the
report. An addition that a model lacks is neutral in its draws.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism import ModelMixture
from onlinebayes.inference import Belief, saving
from onlinebayes.problems import RefinedModels
from onlinebayes.runs import BadInput

DRAWS = 256
"""Worlds of an export."""

MOMENTS = 20_000
"""Draws from which mean, sd and correlation are taken: an sd errs by half a percent."""

TRIES = 100
"""Draws anew of what left the bounds, before it is set on them."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """A belief as numbers.

    Args:
        theta: draws [SI].
        mean, sd: of each parameter [SI].
        correlation: of the parameters; 0 beside one that does not vary.
        source: file that it was read from.
    """

    theta: Float[Tensor, "N P"]
    mean: Float[Tensor, " P"]
    sd: Float[Tensor, " P"]
    correlation: Float[Tensor, "P P"]
    source: str


def drawn(folder: Path, models: RefinedModels, seed: int = 0) -> Drawn:
    """Draw from what a folder holds.

    Args:
        folder: that ``refine`` wrote to.
        models: read from it.
        seed: decides the draws.

    Raises:
        BadInput: posterior.json lies there, and is not of these models.
    """
    beliefs, generator = _posterior(folder, models), torch.Generator().manual_seed(seed)
    theta = _draws(models.worlds, beliefs, MOMENTS, generator)
    mean, sd = theta.mean(0), theta.std(0)
    still = sd <= 1e-12 * theta.abs().amax(0)
    sd = torch.where(still, torch.zeros_like(sd), sd)
    away = (theta - mean) / torch.where(still, torch.ones_like(sd), sd)
    correlation = (away.T @ away / (len(theta) - 1)).clamp(-1, 1)
    correlation[still], correlation[:, still] = 0.0, 0.0
    correlation.fill_diagonal_(1.0)
    kept = _nearest(away, correlation)
    return Drawn(theta[kept : kept + DRAWS], mean, sd, correlation, "posterior.json" if beliefs else "report.json")


def _nearest(away: Float[Tensor, "M P"], correlation: Float[Tensor, "P P"]) -> int:
    """First row of the 256 draws in a row whose mean, sd and correlation come nearest to those of all.

    Args:
        away: draws, less their mean, in sd.
        correlation: of all.
    """
    blocks = away[: len(away) // DRAWS * DRAWS].unflatten(0, (-1, DRAWS))
    second = blocks.mT @ blocks / DRAWS
    misses = blocks.mean(1).square().sum(1) + (second - correlation).square().sum((1, 2)) / 2
    return DRAWS * int(misses.argmin())


def _draws(worlds: ModelMixture, beliefs: list[Belief], count: int, generator: torch.Generator) -> Tensor:
    """Draw theta of all models' simulator (count, P)."""
    if not beliefs:
        return _within(worlds, count, generator)
    which = torch.multinomial(worlds.weight, count, replacement=True, generator=generator)
    theta = worlds.simulator.nominal.double().repeat(count, 1)
    for k, belief in enumerate(beliefs):
        mine = (which == k).nonzero()[:, 0]
        own = belief.sample((len(mine),), generator).double()
        for column, name in enumerate(belief.space):
            theta[mine, worlds.space.index(name)] = own[:, column]
    return worlds.space.clamp(theta)


def _within(worlds: ModelMixture, count: int, generator: torch.Generator) -> Tensor:
    """Draw from the normal distributions, cut off at the bounds: what leaves them is drawn anew."""
    low, high = worlds.space.low.double(), worlds.space.high.double()
    wide = torch.where(worlds.covariance.diagonal(dim1=1, dim2=2).amax(0) > 0, 0.0, torch.inf)
    root = [_root(one) for one in worlds.covariance]
    which = torch.multinomial(worlds.weight, count, replacement=True, generator=generator)
    theta = torch.empty(count, len(low), dtype=torch.float64)
    left = torch.arange(count)
    for _ in range(TRIES):
        normal = torch.randn(len(left), len(low), generator=generator, dtype=torch.float64)
        roots = torch.stack(root)[which[left]]
        theta[left] = worlds.mean[which[left]] + (roots @ normal[..., None])[..., 0]
        outside = ((theta[left] < low - wide) | (theta[left] > high + wide)).any(1)
        left = left[outside]
        if not len(left):
            break
    return worlds.space.clamp(theta)


def _root(covariance: Float[Tensor, "P P"]) -> Float[Tensor, "P P"]:
    """A square root, of a singular matrix too; what has no variance does not move."""
    sd = covariance.diagonal().clamp_min(0).sqrt()
    scale = torch.where(sd > 0, sd, torch.ones_like(sd))
    values, vectors = torch.linalg.eigh(covariance / scale[:, None] / scale)
    return sd[:, None] * vectors * values.clamp_min(0).sqrt()


def _posterior(folder: Path, models: RefinedModels) -> list[Belief]:
    """Read the beliefs of ``posterior``, one a model; none where it was not asked."""
    path = folder / "posterior.json"
    if not path.is_file():
        return []
    try:
        files = [folder / one["belief"] for one in json.loads(path.read_text("utf-8"))["models"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadInput(f"cannot be read: {error!r}", "run posterior again", where=str(path)) from error
    if len(files) != len(models.problems):
        problem = f"has {len(files)} models, beside {len(models.problems)} refined ones"
        raise BadInput(problem, "run posterior on this folder again", where=str(path))
    return [
        saving.load(file, problem.simulator.parameters) for file, problem in zip(files, models.problems, strict=True)
    ]
