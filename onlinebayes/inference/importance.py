"""Draws from a density that can be evaluated, where an approximation of it is at hand: adaptive importance sampling.

    z_i ~ q_r(z),  r = 1 ... R;       w_i proportional to f(z_i) / (1/R sum_r q_r(z_i))
    q_1 = an approximation, a fifth wider;   q_{r+1} = 1/2 (q_1 + the draws so far, smoothed and a fifth wider)

All draws count, each weighed by the mixture of all that proposed (Cornuet, Marin, Mira and Robert 2012). It ends when
the draws are worth enough equal ones, 1 / sum w^2, or the rounds are spent.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.inference.distributions import Box, TruncatedMixture
from onlinebayes.inference.distributions.algebra import union, widened
from onlinebayes.inference.distributions.kernels import smoothed
from onlinebayes.runs import heed

WIDER = 1.2
"""Factor on a proposal's scales: tails that are thinner than the density's give single draws all the weight."""

LogDensity = Callable[[Float[Tensor, "N P"]], Float[Tensor, " N"]]
"""Theta [SI] -> log f up to a constant, a density in the box's coordinates; -inf where it is zero."""


@dataclass(frozen=True, eq=False)
class WeightedDraws:
    """Draws in the coordinates of a box, those of weight 0 left out.

    Args:
        z: the draws.
        weight: w, of sum 1.
        log_density: log f at the draws.
        number: which of the draws that were made each is, from 0.
        box: where they lie.
        made: how many were made.
        log_mass: log of f's integral over the box, in the box's coordinates.
    """

    z: Float[Tensor, "N P"]
    weight: Float[Tensor, " N"]
    log_density: Float[Tensor, " N"]
    number: Int[Tensor, " N"]
    box: Box
    made: int
    log_mass: float

    @property
    def effective(self) -> float:
        """1 / sum w^2, the number of equally weighted draws that they are worth; 0 without any."""
        return 1 / float(self.weight.square().sum()) if len(self.weight) else 0.0

    def smoothed(self) -> TruncatedMixture:
        """The distribution that they stand for."""
        return smoothed(self.z, self.weight, self.box)


def importance(
    log_density: LogDensity,
    proposal: TruncatedMixture,
    *,
    generator: torch.Generator,
    draws: int = 100,
    enough: float = 150.0,
    rounds: int = 6,
) -> WeightedDraws:
    """Sample.

    Args:
        log_density: log f.
        proposal: the approximation, near f and not thinner.
        generator: decides all draws.
        draws: a round.
        enough: equal draws that are wanted.
        rounds: R at the most.
    """
    box, size = proposal.box, len(proposal.space)
    proposals: list[TruncatedMixture] = [widened(proposal, WIDER)]
    z = torch.zeros(0, size, dtype=torch.float64, device=proposal.mean.device)
    log_f, found = z.sum(1), WeightedDraws(z, z.sum(1), z.sum(1), z.sum(1).long(), box, 0, -math.inf)
    for r in range(rounds):
        heed()
        fresh = proposals[-1].sample_frame((draws,), generator)
        z, log_f = torch.cat([z, fresh]), torch.cat([log_f, log_density(box.from_frame(fresh)).to(log_f)])
        log_q = torch.logsumexp(torch.stack([one.log_prob_frame(z) for one in proposals]), 0) - math.log(len(proposals))
        log_weight = torch.where(torch.isfinite(log_f), log_f - log_q, -math.inf)
        weight = torch.softmax(log_weight, 0)
        kept = (weight > 0).nonzero()[:, 0]  # none where all are -inf: their weights are nan
        log_mass = float(log_weight.logsumexp(0)) - math.log(len(z))
        found = WeightedDraws(z[kept], weight[kept], log_f[kept], kept, box, len(z), log_mass)
        if found.effective >= enough or r + 1 == rounds:
            break
        adapted = widened(found.smoothed(), WIDER) if found.effective > size + 1 else widened(proposal, 2.0 ** (r + 1))
        proposals.append(union([proposals[0], adapted]))
    return found
