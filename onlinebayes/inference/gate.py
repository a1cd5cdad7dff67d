"""Choice of the next proposal: narrower only when the belief proves itself on held-out simulations, wider otherwise.

    alpha_g = credibility of the smallest region of the belief given group g that holds theta_g      (see calibration)
    c = share of g with alpha_g <= level
    c >= level - 2 sqrt(level (1 - level) / G)    proposal = region of the widened belief           (truncated)
    else                                          proposal = the last proposal and a margin around it (wider)

The belief is what is reported; the proposal only says where to simulate. An overconfident belief would cut the truth
out of all later simulations, and nothing that follows could bring it back. A machine that may change has its next truth
anywhere: there the proposal stays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.inference.base import Belief
from onlinebayes.inference.distributions import BoxUniform
from onlinebayes.inference.proposals import Region, TruncatedProposal, truncated, wider


@dataclass(frozen=True)
class Decision:
    """The next proposal.

    Attributes:
        proposal: where the next simulations are drawn.
        coverage: share of held-out truths in the belief's region of the gate's level.
        narrowed: whether the gate let the proposal narrow.
        reason: why, one line.
    """

    proposal: BoxUniform | TruncatedProposal
    coverage: float
    narrowed: bool
    reason: str


@dataclass(frozen=True)
class Gate:
    """Decides on the next proposal.

    Args:
        level: of the region that should hold the held-out truths.
        dilation: factor on the belief's scales before its region is cut out: insurance against what a few dozen
            held-out groups cannot show.
        margin: factor on the last proposal's scales where the belief fails.
        narrows: False where the proposal is to stay as it is.
    """

    level: float = 0.95
    dilation: float = 2.0
    margin: float = 1.5
    narrows: bool = True

    def decide(
        self,
        belief: Belief,
        proposal: Belief,
        credibility: Float[Tensor, " G"],
        *,
        generator: torch.Generator,
    ) -> Decision:
        """The next proposal.

        Args:
            belief: given all real trajectories.
            proposal: where the simulations behind the belief were drawn.
            credibility: alpha_g of the held-out groups.
            generator: for the region's threshold.
        """
        inside = credibility <= self.level
        coverage, slack = float(inside.double().mean()), 2 * math.sqrt(self.level * (1 - self.level) / len(inside))
        found = (
            f"{int(inside.sum())} of {len(inside)} held-out truths lie in the belief's {100 * self.level:g} % region"
        )
        if not self.narrows and isinstance(proposal, BoxUniform | TruncatedProposal):
            return Decision(proposal, coverage, False, f"the proposal stays: {found}")
        if coverage >= self.level - slack:
            within = proposal if isinstance(proposal, Region) else None
            narrow = truncated(belief, within, generator=generator, dilation=self.dilation)
            return Decision(narrow, coverage, True, f"narrowed to {_share(narrow)} of the prior: {found}")
        wide = wider(proposal, generator=generator, dilation=self.margin)
        return Decision(wide, coverage, False, f"widened to {_share(wide)} of the prior: only {found}")


def _share(proposal: BoxUniform | TruncatedProposal) -> str:
    volume = proposal.box.log_volume if isinstance(proposal, BoxUniform) else proposal.log_volume
    return f"{100 * math.exp(volume):.3g} %"
