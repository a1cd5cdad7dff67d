r"""What a plan is worth whose cost differs between the worlds that the belief holds possible.

    theta_k, w_k of the belief;   cost of candidate s = R_k [ S(theta_k, s) ],   sum_k w_k = 1

| risk       | worlds           | R                            |
|------------|------------------|------------------------------|
| mean       | K draws, w = 1/K | sum_k w_k S_k                |
| CVaR       | K draws          | mean over the worst worlds   |
| worst case | K draws          | max_k S_k                    |
| unscented  | 2 P + 1 points   | sum_k w_k S_k                |

CVaR: Rockafellar and Uryasev 2000. Unscented transform: Julier and Uhlmann 1997; for planning
Barcelos et al. 2020, DISCO.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Generator, Tensor

from onlinebayes.runs import BadInput


@runtime_checkable
class Risk(Protocol):
    """Choice of the worlds that a plan is tried in, and the rule by which their costs become one."""

    def worlds(self, draws: Float[Tensor, "D P"], number: int, generator: Generator) -> tuple[Tensor, Tensor]:
        """Parameters (K, P) and their weights (K,), which sum to 1.

        Args:
            draws: of the belief.
            number: of worlds wanted.
            generator: of the choice.
        """

    def over(
        self, costs: Float[Tensor, "*batch K S"], weights: Float[Tensor, "*batch K S"]
    ) -> Float[Tensor, "*batch S"]:
        """One cost a candidate; the weights sum to 1 over the worlds, and are 0 where a world is left out."""


@dataclass(frozen=True)
class Mean:
    """The expected cost."""

    def worlds(self, draws: Float[Tensor, "D P"], number: int, generator: Generator) -> tuple[Tensor, Tensor]:
        """See :class:`Risk`."""
        return _drawn(draws, number, generator)

    def over(
        self, costs: Float[Tensor, "*batch K S"], weights: Float[Tensor, "*batch K S"]
    ) -> Float[Tensor, "*batch S"]:
        """See :class:`Risk`."""
        return (weights * costs).sum(-2)


@dataclass(frozen=True)
class CVaR:
    """The expected cost in the worst worlds.

    Args:
        level: their share of the belief, in (0, 1]; 1 is the mean.
    """

    level: float = 0.25

    def __post_init__(self) -> None:
        if not 0 < self.level <= 1:
            raise BadInput(f"CVaR at level {self.level:g}", "the level is the share of the worst worlds, in (0, 1]")

    def worlds(self, draws: Float[Tensor, "D P"], number: int, generator: Generator) -> tuple[Tensor, Tensor]:
        """See :class:`Risk`."""
        return _drawn(draws, number, generator)

    def over(
        self, costs: Float[Tensor, "*batch K S"], weights: Float[Tensor, "*batch K S"]
    ) -> Float[Tensor, "*batch S"]:
        """See :class:`Risk`; the world at the edge of the share counts in part."""
        ordered, place = costs.sort(dim=-2, descending=True)
        weight = weights.gather(-2, place)
        before = weight.cumsum(-2) - weight
        return (torch.minimum(weight, (self.level - before).clamp(min=0)) * ordered).sum(-2) / self.level


@dataclass(frozen=True)
class WorstCase:
    """The greatest cost in any world."""

    def worlds(self, draws: Float[Tensor, "D P"], number: int, generator: Generator) -> tuple[Tensor, Tensor]:
        """See :class:`Risk`."""
        return _drawn(draws, number, generator)

    def over(
        self, costs: Float[Tensor, "*batch K S"], weights: Float[Tensor, "*batch K S"]
    ) -> Float[Tensor, "*batch S"]:
        """See :class:`Risk`."""
        return torch.where(weights > 0, costs, -torch.inf).amax(-2)


@dataclass(frozen=True)
class Unscented:
    r"""The expected cost by 2 P + 1 chosen points, which have the mean m and the covariance C of the belief's draws.

        theta_0 = m,   theta_{+-i} = m +- sqrt(P + kappa) l_i,   C = L L^T,  l_i column i of the **lower** factor L
        w_0 = kappa / (P + kappa),   w_{+-i} = 1 / (2 (P + kappa))

    The columns of an upper factor U, C = U^T U, are not those of L: such points have another covariance wherever
    parameters are correlated. Points that leave the simulator's bounds are moved back to them, and their moments with
    them; with kappa = 1 and P <= 2 those of a uniform belief stay inside.

    Args:
        kappa: weight of the mean, >= 0, and how far out the others are.
    """

    kappa: float = 1.0

    def __post_init__(self) -> None:
        if not self.kappa >= 0:
            raise BadInput(f"kappa = {self.kappa:g}", "needs kappa >= 0, so that no world has a negative weight")

    def worlds(self, draws: Float[Tensor, "D P"], number: int, generator: Generator) -> tuple[Tensor, Tensor]:
        """See :class:`Risk`; the number is always 2 P + 1."""
        mean = draws.mean(0)
        return self.points(mean, (draws - mean).T @ (draws - mean) / len(draws))

    def points(self, mean: Float[Tensor, " P"], covariance: Float[Tensor, "P P"]) -> tuple[Tensor, Tensor]:
        """Points (2 P + 1, P) and weights (2 P + 1,) for a mean and a covariance."""
        size, spread = len(mean), len(mean) + self.kappa
        columns = spread**0.5 * _lower(covariance).T
        weights = torch.full((2 * size + 1,), 0.5 / spread).to(mean)
        weights[0] = self.kappa / spread
        return torch.cat((mean[None], mean + columns, mean - columns)), weights

    def over(
        self, costs: Float[Tensor, "*batch K S"], weights: Float[Tensor, "*batch K S"]
    ) -> Float[Tensor, "*batch S"]:
        """See :class:`Risk`."""
        return (weights * costs).sum(-2)


def _drawn(draws: Float[Tensor, "D P"], number: int, generator: Generator) -> tuple[Tensor, Tensor]:
    """Some of the draws, without replacement as long as there are enough; equal weights."""
    if number <= len(draws):
        rows = torch.randperm(len(draws), generator=generator)[:number]
    else:
        rows = torch.randint(len(draws), (number,), generator=generator)
    return draws[rows], torch.full((number,), 1 / number).to(draws)


def _lower(covariance: Float[Tensor, "P P"]) -> Float[Tensor, "P P"]:
    """Lower Cholesky factor; of a singular covariance the one from its eigenvectors, made triangular."""
    factor, failed = torch.linalg.cholesky_ex(covariance)
    if not bool(failed):
        return factor
    values, vectors = torch.linalg.eigh(covariance)
    return torch.linalg.qr((vectors * values.clamp(min=0).sqrt()).T).R.T
