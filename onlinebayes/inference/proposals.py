"""The proposal of the next simulations: the prior, cut to the highest-density region of what is known so far.

    R = {u : q_w(u) >= c},    P_{q_w}(R) = mass

q_w is the posterior given each real trajectory, united over the trajectories, with every component widened. Drawing
uniformly from R keeps the next round's target the posterior itself, with no correction (Deistler, Goncalves and Macke
2022), and no part of the prior that is still in question is lost: R holds ``mass`` of a density that is broader than
the posterior. R follows a ridge where a bounding box would not (4 nats against 9 on CartPole).

Points of R are drawn by rejection, either from a box around it (acceptance |R| / |box|) or from q_w itself, where u is
kept with probability c / q_w(u); whichever accepted more in a trial.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.inference.base import Belief
from onlinebayes.inference.distributions import Box, BoxUniform, TruncatedMixture
from onlinebayes.inference.distributions.algebra import in_box, widened
from onlinebayes.inference.posterior import Posterior
from onlinebayes.parameters import ParameterSpace

TRIAL, TRIES = 4096, 200
TINY = 1e-9  # shortest side of a box
ROUNDING = 1e-6  # of z and log densities, so that a draw that went through theta still counts as inside


@runtime_checkable
class Region(Protocol):
    """A set of parameters."""

    def contains(self, theta: Tensor) -> Tensor:
        """Check whether theta (..., P) lies in it."""
        ...


class TruncatedProposal:
    """Uniform (on the unit cube's scale) over the region where a mixture is dense enough.

    Args:
        mixture: q_w; the region lies within its box.
        threshold: log density c in the coordinates z of the mixture's box; the region is where q_w is no smaller.
        samples: points z (M, P) of the region, M >= 1, from which its box is found.
        generator: for the trial that chooses the sampler and estimates the volume.
        within: another region or box; only what lies in it too belongs to the region.

    Attributes:
        box: a box in the unit cube around the region; the next estimator's.
        log_volume: log of the share of the unit cube that the region fills (estimate).
        acceptance: share of candidates that the sampler keeps (estimate).
    """

    def __init__(
        self,
        mixture: TruncatedMixture,
        threshold: float,
        samples: Float[Tensor, "M P"],
        generator: torch.Generator,
        within: Region | None = None,
    ) -> None:
        self.space: ParameterSpace = mixture.space
        self._mixture, self._threshold, self._known = mixture, threshold, samples
        self._within = within._bare() if isinstance(within, TruncatedProposal) else within
        self._low, self._high = _around(samples)
        outer = mixture.box
        width = outer.high - outer.low
        low, high = (outer.low + z.to(width) * width for z in (self._low, self._high))
        self.box = Box(self.space, low.clamp(0, 1 - TINY), torch.maximum(high, low + TINY).clamp(TINY, 1))
        in_a_box = float(self._inside(self._from_box(TRIAL, generator)).double().mean())
        # The share kept of draws from q_w is c |R|, which gives the volume without a box.
        in_mixture = float(self._keep_probability(self._from_mixture(TRIAL, generator)).mean())
        self._use_box = in_a_box >= in_mixture
        self.acceptance = max(in_a_box, in_mixture)
        log_share = (
            math.log(in_a_box) + float(torch.log(self._high - self._low).sum())
            if self._use_box
            else math.log(max(in_mixture, 1e-300)) - threshold
        )
        self.log_volume = min(0.0, log_share + outer.log_volume)

    @property
    def mixture(self) -> TruncatedMixture:
        """q_w."""
        return self._mixture

    @property
    def within(self) -> Region | None:
        """The region that this one is a part of."""
        return self._within

    def values(self) -> dict[str, Any]:
        """What, with the mixture and the outer region, makes up the proposal; for a checkpoint."""
        return {
            "threshold": self._threshold,
            "known": self._known,
            "sides": torch.stack((self._low, self._high)),
            "box": torch.stack((self.box.low, self.box.high)),
            "use_box": self._use_box,
            "acceptance": self.acceptance,
            "log_volume": self.log_volume,
        }

    @classmethod
    def restored(cls, mixture: TruncatedMixture, within: Region | None, values: Mapping[str, Any]) -> TruncatedProposal:
        """The proposal of which :meth:`values` were saved; no trial is run again."""
        self = cls.__new__(cls)
        self.space, self._mixture, self._within = mixture.space, mixture, within
        self._threshold, self._known = values["threshold"], values["known"]
        self._low, self._high = values["sides"]
        self.box = Box(mixture.space, *values["box"])
        self._use_box, self.acceptance, self.log_volume = (
            values["use_box"],
            values["acceptance"],
            values["log_volume"],
        )
        return self

    def contains(self, theta: Float[Tensor, "*batch P"]) -> Bool[Tensor, "*batch"]:
        """Check whether theta lies in the region."""
        return self._inside(self._mixture.box.to_frame(theta).to(self._low)).to(theta.device)

    def log_prob(self, theta: Float[Tensor, "*batch P"]) -> Float[Tensor, "*batch"]:
        """Log density on the original scale [1 / units], by the estimated volume; -inf outside."""
        density = self.space.log_abs_det(self.space.clamp(theta.double())) - self.log_volume
        return torch.where(self.contains(theta), density, -torch.inf)

    def sample(
        self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None
    ) -> Float[Tensor, "*shape P"]:
        """Theta (*shape, P), float64, each inside the region.

        The number of tries is bounded; what is then still missing (a sliver too thin to hit) is filled with the
        posterior's own points inside the region.
        """
        wanted = torch.Size(shape).numel()
        found: list[Tensor] = []
        count = 0
        for _ in range(TRIES):
            if count >= wanted:
                break
            size = int(min(200_000, max(256, 1.3 * (wanted - count) / max(self.acceptance, 1e-3))))
            found.append(self._draw(size, generator))
            count += len(found[-1])
        if count < wanted:
            index = (self._uniform((wanted - count,), generator) * len(self._known)).long()
            found.append(self._known[index])
        z = torch.cat(found)[:wanted] if found else self._known[:0]
        return self._mixture.box.from_frame(z).reshape(*shape, len(self.space))

    def _bare(self) -> TruncatedProposal:
        """The region alone, without the points that draws may need: regions within regions stay small."""
        bare = copy.copy(self)
        bare._known = self._known[:0].clone()  # a view would keep all points in memory, and in every checkpoint
        return bare

    def _draw(self, size: int, generator: torch.Generator | None) -> Tensor:
        if self._use_box:
            z = self._from_box(size, generator)
            return z[self._inside(z)]
        z = self._from_mixture(size, generator)
        uniform = self._uniform((size,), generator)
        return z[uniform < self._keep_probability(z)]

    def _from_box(self, size: int, generator: torch.Generator | None) -> Tensor:
        return self._low + self._uniform((size, len(self.space)), generator) * (self._high - self._low)

    def _uniform(self, shape: tuple[int, ...], generator: torch.Generator | None) -> Tensor:
        device = self._low.device
        drawn_on = generator.device if generator is not None else device
        return torch.rand(shape, dtype=torch.float64, device=drawn_on, generator=generator).to(device)

    def _from_mixture(self, size: int, generator: torch.Generator | None) -> Tensor:
        return self._mixture.sample_frame((size,), generator)

    def _keep_probability(self, z: Tensor) -> Tensor:
        return torch.where(self._inside(z), torch.exp(self._threshold - self._mixture.log_prob_frame(z)), 0.0)

    def _inside(self, z: Tensor) -> Tensor:
        inside = ((z >= -ROUNDING) & (z <= 1 + ROUNDING)).all(-1)
        inside = inside & (self._mixture.log_prob_frame(z) >= self._threshold - ROUNDING)
        return inside if self._within is None else inside & self._within.contains(self._mixture.box.from_frame(z))


def truncated(
    posterior: Belief,
    within: Region | None = None,
    *,
    generator: torch.Generator,
    mass: float = 0.99,
    dilation: float = 1.3,
    growth: float = 0.25,
    samples: int = 20_000,
) -> TruncatedProposal | BoxUniform:
    """The next proposal from a posterior (conditioned on the union of the real trajectories).

    Args:
        posterior: what is known; an unconditioned one gives its own box back, and of one that is no mixture the box
            around its densest draws is taken.
        within: the proposal that the posterior was trained on, if the next is to be a part of it: the posterior has
            seen nothing elsewhere. Where the two have nothing in common it is left out.
        generator: for the region's threshold and its sampler's trial.
        mass: share of the widened posterior that the region holds. With the default dilation 0.99 holds 0.9996 of a
            Gaussian posterior; 0.997 would follow the last percent of a mixture's weight, which a thousand
            simulations do not teach it, and Pendulum stalled there (5 nats after six rounds against 8).
        dilation: factor on the components' scales, at least 1: insurance against an overconfident posterior.
        growth: how far the region may reach beyond the box of the simulations that the posterior was trained on, in
            widths of that box: out to where the posterior leans, but not back to where earlier rounds ruled out.
        samples: points by which the threshold is found.

    Raises:
        ValueError: a mass outside (0, 1), a dilation below 1 or a negative growth.
    """
    if not 0 < mass < 1 or dilation < 1 or growth < 0:
        raise ValueError(
            f"mass = {mass}, dilation = {dilation}, growth = {growth}: needs 0 < mass < 1, dilation >= 1, growth >= 0"
        )
    mixture = posterior.distribution if isinstance(posterior, Posterior) else posterior
    if isinstance(mixture, BoxUniform):
        return mixture
    if not isinstance(mixture, TruncatedMixture):
        return _box_around(mixture, dilation, mass, samples, generator)
    return _cut(widened(in_box(mixture, grown(mixture.box, growth)), dilation), within, generator, mass, samples)


def _box_around(belief: Belief, dilation: float, mass: float, samples: int, generator: torch.Generator) -> BoxUniform:
    """The box around the densest draws of a belief, each side ``dilation`` times as long, inside the unit cube."""
    theta = belief.sample((samples,), generator)
    # The few draws of the tails would stretch the box to the bounds.
    log_q = belief.log_prob(theta) - belief.space.log_abs_det(theta)
    u = belief.space.to_unit(theta[log_q >= torch.quantile(log_q, 1 - mass)])
    low, high = u.amin(0), u.amax(0)
    margin = (dilation - 1) / 2 * (high - low) + TINY
    return BoxUniform(
        belief.space, Box(belief.space, (low - margin).clamp(0, 1 - TINY), (high + margin).clamp(TINY, 1))
    )


def wider(
    proposal: Belief,
    *,
    generator: torch.Generator,
    dilation: float = 1.5,
    growth: float = 0.25,
    mass: float = 0.99,
    samples: int = 20_000,
) -> TruncatedProposal | BoxUniform:
    """A proposal that holds this one and a margin around it.

    Args:
        proposal: any; of a region's mixture the components are widened, a box's sides move out.
        generator: for the region's threshold and its sampler's trial.
        dilation: factor on the components' scales.
        growth: how far each side of the box moves out [widths of the box].
        mass, samples: as for :func:`truncated`.
    """
    if not isinstance(proposal, TruncatedProposal):
        return BoxUniform(proposal.space, grown(proposal.box, growth))
    mixture = proposal.mixture
    wide = widened(in_box(mixture, grown(mixture.box, growth)), dilation)
    return _cut(wide, None, generator, mass, samples)


def _cut(
    wide: TruncatedMixture, within: Region | None, generator: torch.Generator, mass: float, samples: int
) -> TruncatedProposal:
    """The highest-density region of a mixture that holds ``mass`` of it, cut to another region where they meet."""
    points = wide.sample_frame((samples,), generator)
    log_q = wide.log_prob_frame(points)
    threshold = float(torch.quantile(log_q, 1 - mass))
    points = points[log_q >= threshold]
    if within is not None:
        shared = within.contains(wide.box.from_frame(points))
        points, within = (points[shared], within) if bool(shared.any()) else (points, None)
    return TruncatedProposal(wide, threshold, points, generator, within)


def grown(box: Box, growth: float) -> Box:
    """The box with every side moved out by ``growth`` of its width, inside the unit cube."""
    margin = growth * (box.high - box.low)
    return Box(box.space, (box.low - margin).clamp(min=0), (box.high + margin).clamp(max=1))


def _around(z: Tensor) -> tuple[Tensor, Tensor]:
    """Lowest and highest corner of a box around points of [0, 1]^P, a little larger, with sides that cannot vanish."""
    low, high = z.amin(0), z.amax(0)
    margin = 0.05 * (high - low) + TINY
    return (low - margin).clamp(0, 1 - TINY), (high + margin).clamp(TINY, 1)
