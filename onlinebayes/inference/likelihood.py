"""The posterior by the likelihood itself: a filter through the simulator, weighted draws, nothing learnt.

    p(theta | y_1 ... y_n)  prop. to  prod_i p(y_i | theta)  on the box         p(y | theta): see ``SimulatorFilter``
    draws z_j ~ g,    w_j = p(y | z_j) / g(z_j),    Z = mean w_j,    log q(z) = log p(y | z) - log Z

Where sensors are Gaussian and independent, dynamics without noise of their own and nearly linear over one noise, this
is the exact posterior: the reference that every other estimator is compared with. g is a mixture of Gaussians and a
uniform share: first about the peaks of the likelihood found from several starts; then, round by round, about draws
that were heavy (population Monte Carlo, Cappe et al. 2004), all rounds weighed by the mixture of all g's (Cornuet et
al. 2012). A pendulum upright has a needle for a mode, which no grid and no simulation from the start
meets; the filter's slope leads there (see ``likeliest``).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from time import monotonic
from typing import Any

import torch
from jaxtyping import Float
from scipy.stats import qmc
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.embeddings import FilteredEmbedding, Rows
from onlinebayes.embeddings.likeliest import climbed
from onlinebayes.inference.base import FitReport
from onlinebayes.inference.distributions import Box, TruncatedMixture
from onlinebayes.inference.distributions.sampling import choose
from onlinebayes.inference.trajectories import TrajectoryKeys
from onlinebayes.simulators import Simulator, Task

ROUNDS = 3
"""Of draws; ridges that bend are found in the second."""

FEW_STARTS, MANY_STARTS = 7, 127
"""To climb from: the second where the first left less than SOUND effective draws, about one set of a hundred."""

SOUND = 50.0
"""Effective draws, at least: a peak that was missed leaves one or two."""

UNIFORM = 0.05
"""Share of the draws that is uniform in the box: bounds the weights."""

WIDER = 1.4
"""Factor on the scales of what is drawn from: a proposal narrower than the posterior has weights without bounds."""

FLAT = 0.5
"""Standard deviation of z beside which a flat likelihood is rounded off, in widths of the box."""

KERNELS = 30
"""Heavy draws about which the next round draws."""

AT_ONCE = 20_000
"""Trajectories in one pass of the filter: bounds memory."""


class LikelihoodEstimator:
    """A :class:`~onlinebayes.inference.PosteriorEstimator` that evaluates the likelihood.

    Args:
        simulator: whose parameters are inferred.
        task: what is commanded and observed.
        box: where theta lies.
        state: observations (M, O) -> complete states (M,).
        observe: the inverse of ``state``, for a task that gives several observations; the task's own without it.
        draws: in each round, for each posterior.
        keys: where trajectories lie in a TensorDict.

    Attributes:
        embedding: holds the filter; :meth:`fit` reads the sensors' noise and the starts off simulations into it.
    """

    def __init__(
        self,
        simulator: Simulator,
        task: Task,
        box: Box,
        *,
        state: Callable[[Tensor], TensorDict],
        observe: Callable[[TensorDictBase], Any] | None = None,
        draws: int = 500,
        keys: TrajectoryKeys | None = None,
    ) -> None:
        self.space, self.box, self._draws = box.space, box, draws
        self.keys = keys if keys is not None else TrajectoryKeys()
        self.embedding = FilteredEmbedding(
            simulator,
            box,
            task.observation_size,
            task.action_spec.shape[-1],
            state=state,
            command=task.command,
            observe=observe or task.observe,
        )

    def fit(
        self, simulations: TensorDictBase, groups: TensorDictBase | None = None, *, generator: torch.Generator
    ) -> FitReport:
        """Read noise and starts off simulations (B, T); theta and groups are not looked at."""
        begin = monotonic()
        self.embedding.fit(*self.keys.read(simulations, self.embedding.starts))
        return FitReport(seconds=monotonic() - begin)

    def condition(self, trajectories: TensorDictBase) -> WeightedPosterior:
        """What the trajectories (n, T) of one system say together."""
        return self.each(trajectories.unsqueeze(0))[0]

    def each(self, groups: TensorDictBase) -> WeightedPosterior:
        """G posteriors as one batch (G,), one for each group (G, n, T)."""
        *values, mask = self.keys.read(groups.flatten(0, 1), self.embedding.starts)
        rows = self.embedding.rows(self.embedding.features(*values), mask)
        return _weighted(_Likelihood(self.embedding, rows, groups.shape[1]), self.box, self._draws)


class _Likelihood:
    """log p of G sets of trajectories."""

    def __init__(self, embedding: FilteredEmbedding, rows: Rows, members: int) -> None:
        self._embedding = embedding
        self.model, self.members = embedding.model, members
        self.rows = [part.unflatten(0, (-1, members)) for part in rows]

    @property
    def sets(self) -> int:
        """G."""
        return len(self.rows[0])

    def some(self, index: Tensor) -> Rows:
        """The trajectories of sets, one set behind the other."""
        return Rows(*(part[index].flatten(0, 1) for part in self.rows))

    def picked(self, index: Tensor) -> _Likelihood:
        """Of some sets."""
        return _Likelihood(self._embedding, self.some(index), self.members)

    def at(self, z: Float[Tensor, "N G P"]) -> Float[Tensor, "N G"]:
        """Log likelihood, up to a constant of each set."""
        N, G, P = z.shape
        index = torch.arange(G, device=z.device).repeat(N)
        found = [
            self.model.log_likelihood(self.some(i), flat.repeat_interleave(self.members, 0))
            for i, flat in zip(
                index.split(max(1, AT_ONCE // self.members)),
                z.reshape(-1, P).split(max(1, AT_ONCE // self.members)),
                strict=True,
            )
        ]
        return torch.cat(found).reshape(N, G, self.members).sum(-1)


class WeightedPosterior:
    """A batch of posteriors (*batch) known by weighted draws, with the density of any theta by the likelihood.

    Args:
        likelihood: of the sets.
        box: outside of which the density is zero.
        z: draws (M, G, P).
        log_likelihood: at the draws (M, G).
        log_weights: of the draws (M, G), as log likelihood over density of the proposal.
        single: a batch of shape (), not (1,).
    """

    def __init__(
        self,
        likelihood: _Likelihood,
        box: Box,
        z: Float[Tensor, "M G P"],
        log_likelihood: Float[Tensor, "M G"],
        log_weights: Float[Tensor, "M G"],
        single: bool = False,
    ) -> None:
        self.box, self.space = box, box.space
        self._likelihood, self._z, self._values, self._weights = likelihood, z, log_likelihood, log_weights
        self._single = single

    @property
    def batch_shape(self) -> torch.Size:
        """Shape of the batch."""
        return torch.Size([] if self._single else [self._z.shape[1]])

    def __getitem__(self, index: int) -> WeightedPosterior:
        """One of the batch."""
        z, values, weights = (part[:, index : index + 1] for part in (self._z, self._values, self._weights))
        one = self._likelihood.picked(torch.tensor([index]))
        return WeightedPosterior(one, self.box, z, values, weights, single=True)

    @property
    def log_evidence(self) -> Float[Tensor, "*batch"]:
        """log Z, against the uniform density on the box."""
        return self._shaped(torch.logsumexp(self._weights, 0) - math.log(len(self._weights)))

    @property
    def effective(self) -> Float[Tensor, "*batch"]:
        """Effective number of draws, (sum w)^2 / sum w^2: below some tens the posterior is not to be trusted."""
        weights = torch.softmax(self._weights, 0)
        return self._shaped(1 / weights.square().sum(0))

    def log_prob(self, theta: Float[Tensor, "*shape P"]) -> Float[Tensor, "*out"]:
        """Log density at theta (*sample, *batch, P) [1 / units]; -inf outside the box."""
        inside = self.box.contains(theta)
        theta = torch.where(inside.unsqueeze(-1), theta, self.space.from_unit(self.box.low.to(theta)))
        z = self.box.to_frame(theta).double()
        shape = z.shape[: z.ndim - 1 - len(self.batch_shape)]
        z = z.expand(*shape, *self.batch_shape, z.shape[-1])
        many = z.reshape(-1, self._z.shape[1], z.shape[-1])
        values = self._likelihood.at(many).reshape((*shape, *self.batch_shape)) - self.log_evidence
        return torch.where(inside, values + self.box.log_abs_det(theta), -torch.inf)

    def sample(self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None) -> Tensor:
        """Theta (*shape, *batch, P): draws picked anew by their weights."""
        chosen = choose(torch.log_softmax(self._weights, 0).T, torch.Size(shape).numel(), generator)  # (G, count)
        z = self._z.movedim(1, 0).gather(1, chosen[..., None].expand(-1, -1, self._z.shape[-1])).movedim(1, 0)
        return self.box.from_frame(z).reshape(*shape, *self.batch_shape, z.shape[-1])

    def credibility(self, theta: Float[Tensor, "*batch P"]) -> Float[Tensor, "*batch"]:
        """Of the smallest region that holds theta, by the draws that there are; see ``calibration``."""
        truth = self.log_prob(theta) - self.box.log_abs_det(theta) + self.log_evidence
        weights = torch.softmax(self._weights, 0)
        return self._shaped((weights * (self._values >= truth.reshape(1, -1))).sum(0))

    def replaced(self, index: Tensor, others: WeightedPosterior) -> WeightedPosterior:
        """With others in the place of the posteriors ``index`` (N,) of the batch."""
        parts = [part.clone() for part in (self._z, self._values, self._weights)]
        for part, new in zip(parts, (others._z, others._values, others._weights), strict=True):
            part[:, index] = new
        return WeightedPosterior(self._likelihood, self.box, parts[0], parts[1], parts[2])

    def _shaped(self, values: Tensor) -> Tensor:
        return values.reshape(self.batch_shape)


@torch.no_grad()
def _weighted(likelihood: _Likelihood, box: Box, draws: int) -> WeightedPosterior:
    """The posteriors of all sets, again from many more starts where few draws have all the weight."""
    found = _rounds(likelihood, box, draws, FEW_STARTS)
    poor = (found.effective < SOUND).nonzero()[:, 0]
    return found.replaced(poor, _rounds(likelihood.picked(poor), box, draws, MANY_STARTS)) if len(poor) else found


def _rounds(likelihood: _Likelihood, box: Box, draws: int, starts: int) -> WeightedPosterior:
    """The posteriors of all sets; their draws are the same at every call."""
    generator = torch.Generator().manual_seed(0)
    proposals = [_about_peaks(likelihood, box, starts)]
    z, values = [], []
    for turn in range(ROUNDS):
        z.append(_drawn(proposals[-1], draws, generator))
        values.append(likelihood.at(z[-1]))
        every = torch.cat(z)
        density = torch.stack([_defensive(proposal, every) for proposal in proposals]).logsumexp(0)
        weights = torch.cat(values) - density + math.log(turn + 1)
        if turn + 1 < ROUNDS:
            proposals.append(_about_heavy(every, weights, box, generator))
    return WeightedPosterior(likelihood, box, every, torch.cat(values), weights)


def _drawn(proposal: TruncatedMixture, draws: int, generator: torch.Generator) -> Float[Tensor, "M G P"]:
    """Draws, some of them uniform."""
    z = proposal.sample_frame((draws,), generator)
    even = torch.rand(z.shape[:2], dtype=torch.float64, generator=generator) < UNIFORM
    return torch.where(even[..., None], torch.rand(z.shape, dtype=torch.float64, generator=generator), z)


def _defensive(proposal: TruncatedMixture, z: Float[Tensor, "M G P"]) -> Float[Tensor, "M G"]:
    """Log density of such draws."""
    mixture = proposal.log_prob_frame(z) + math.log1p(-UNIFORM)
    return torch.logaddexp(mixture, torch.full_like(mixture, math.log(UNIFORM)))


def _about_peaks(likelihood: _Likelihood, box: Box, starts: int) -> TruncatedMixture:
    """A Gaussian about the peak above each of some evenly spread starts, wider than it, the higher the heavier."""
    G, K = likelihood.sets, starts
    first = torch.from_numpy(qmc.Sobol(len(box.space), scramble=False).random(K + 1)[1:])
    rows = likelihood.some(torch.arange(G).repeat(K))
    found = climbed(likelihood.model, rows, likelihood.members, first.repeat_interleave(G, 0))
    H = found.evidence.information + torch.eye(found.z.shape[1]).to(found.z) / FLAT**2
    lower = torch.linalg.cholesky(torch.cholesky_inverse(torch.linalg.cholesky(H)))
    mass = found.evidence.log_likelihood + torch.diagonal(lower, dim1=-2, dim2=-1).log().sum(-1)
    mass, place, lower = (part.unflatten(0, (K, G)).movedim(1, 0) for part in (mass, found.z, lower))
    return TruncatedMixture(mass, place, WIDER * lower, box)


def _about_heavy(z: Tensor, log_weights: Tensor, box: Box, generator: torch.Generator) -> TruncatedMixture:
    """Gaussians about draws picked by weight, as wide as Silverman's rule (1986) for as many kernels."""
    P = z.shape[-1]
    weights = torch.softmax(log_weights, 0)
    away = z - (weights[..., None] * z).sum(0)
    covariance = torch.einsum("mg,mgp,mgq->gpq", weights, away, away) + 1e-14 * torch.eye(P).to(z)
    width = WIDER * (4 / (KERNELS * (P + 2))) ** (1 / (P + 4))
    chosen = choose(torch.log_softmax(log_weights, 0).T, KERNELS, generator)
    place = z.movedim(1, 0).gather(1, chosen[..., None].expand(-1, -1, P))
    lower = width * torch.linalg.cholesky(covariance)[:, None].expand(-1, KERNELS, P, P)
    return TruncatedMixture(torch.zeros(chosen.shape).to(z), place, lower, box)
