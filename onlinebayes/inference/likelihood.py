"""The posterior by the likelihood itself: a filter through the simulator, weighted draws, nothing learnt.

    p(theta | y_1 ... y_n)  prop. to  prod_i p(y_i | theta)  on the box         p(y | theta): see ``SimulatorFilter``
    log q(theta) = log p(y | theta) - log Z,    Z by importance sampling, see ``importance``

Where sensors are Gaussian and independent, dynamics without noise of their own and nearly linear over one noise, this
is the exact posterior: the reference that every other estimator is compared with. It is drawn from Gaussians about the
peaks of the likelihood that are found from several starts, and from the whole box. A pendulum upright has a needle for
a mode, which no grid and no simulation from the start meets; the filter's slope leads there (see ``likeliest``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from time import monotonic

import torch
from jaxtyping import Float
from scipy.stats import qmc
from tensordict import TensorDictBase
from torch import Tensor

from onlinebayes.embeddings import FilteredEmbedding, Rows, SimulatorFilter
from onlinebayes.embeddings.likeliest import climbed
from onlinebayes.inference.base import FitReport
from onlinebayes.inference.distributions import Box, TruncatedMixture
from onlinebayes.inference.distributions.sampling import choose
from onlinebayes.inference.importance import WeightedDraws, importance
from onlinebayes.inference.trajectories import TrajectoryKeys

FEW_STARTS, MANY_STARTS = 7, 127
"""To climb from: the second where the first left less than SOUND effective draws, about one set of a hundred."""

SOUND = 50.0
"""Effective draws, at least: a peak that was missed leaves one or two."""

UNIFORM = 0.05
"""Share of the draws that is next to uniform in the box: bounds the weights."""

FLAT = 0.5
"""Standard deviation of z beside which a flat likelihood is rounded off, in widths of the box."""

AT_ONCE = 20_000
"""Trajectories in one pass of the filter: bounds memory."""


class LikelihoodEstimator:
    """A :class:`~onlinebayes.inference.PosteriorEstimator` that evaluates the likelihood.

    Args:
        model: the filter, over the box; ``filter_of`` builds one.
        box: where theta lies.
        action: number of action values A.
        draws: in each round of importance sampling.
        enough: effective draws at which the rounds end.
        keys: where trajectories lie in a TensorDict.

    Attributes:
        model: as given; :meth:`fit` reads the sensors' noise and the starts off simulations into it.
    """

    def __init__(
        self,
        model: SimulatorFilter,
        box: Box,
        action: int,
        *,
        draws: int = 300,
        enough: float = 300.0,
        keys: TrajectoryKeys | None = None,
    ) -> None:
        self.space, self.box, self.model = box.space, box, model
        self._draws, self._enough = draws, enough
        self._embedding = FilteredEmbedding(model, action)
        self._keys = keys if keys is not None else TrajectoryKeys()

    def fit(
        self, simulations: TensorDictBase, groups: TensorDictBase | None = None, *, generator: torch.Generator
    ) -> FitReport:
        """Read noise and starts off simulations (B, T); theta and groups are not looked at."""
        begin = monotonic()
        self._embedding.fit(*self._keys.read(self._keys.usable(simulations), self.model.noise))
        return FitReport(seconds=monotonic() - begin)

    def condition(self, trajectories: TensorDictBase) -> LikelihoodPosterior:
        """Return the posterior given all trajectories (n, T) of one system."""
        return self.each(trajectories.unsqueeze(0))[0]

    def each(self, groups: TensorDictBase) -> LikelihoodPosteriors:
        """G posteriors as one batch (G,), one for each group (G, n, T); their draws are the same at every call."""
        *values, mask = self._keys.read(groups.flatten(0, 1), self.model.noise)
        rows = self._embedding.rows(self._embedding.features(*values), mask)
        sets = [Rows(*each) for each in zip(*(part.unflatten(0, groups.shape[:2]) for part in rows), strict=True)]
        found = self._found(sets, FEW_STARTS)
        poor = [g for g, posterior in enumerate(found) if posterior.effective < SOUND]
        for g, posterior in zip(poor, self._found([sets[g] for g in poor], MANY_STARTS), strict=True):
            found[g] = posterior
        return LikelihoodPosteriors(found)

    @torch.no_grad()
    def _found(self, sets: Sequence[Rows], starts: int) -> list[LikelihoodPosterior]:
        if not sets:
            return []
        proposals = self._about_peaks(sets, starts)
        return [self._one(rows, proposals[g]) for g, rows in enumerate(sets)]

    def _one(self, rows: Rows, proposal: TruncatedMixture) -> LikelihoodPosterior:
        likelihood = _Likelihood(self.model, rows, self.box)
        generator = torch.Generator().manual_seed(0)
        drawn = importance(likelihood, proposal, generator=generator, draws=self._draws, enough=self._enough)
        return LikelihoodPosterior(likelihood, drawn)

    def _about_peaks(self, sets: Sequence[Rows], starts: int) -> TruncatedMixture:
        """For each set a Gaussian about the peak above each of some evenly spread starts, and one over all the box."""
        G, P = len(sets), len(self.space)
        first = torch.from_numpy(qmc.Sobol(P, scramble=False).random(starts + 1)[1:]).to(self.model.noise)
        rows = Rows(*(torch.cat(part).repeat(starts, *[1] * (part[0].ndim - 1)) for part in zip(*sets, strict=True)))
        found = climbed(self.model, rows, len(sets[0].mask), first.repeat_interleave(G, 0))
        H = found.evidence.information + torch.eye(P).to(found.z) / FLAT**2
        lower = torch.linalg.cholesky(torch.cholesky_inverse(torch.linalg.cholesky(H)))
        mass = found.evidence.log_likelihood + torch.diagonal(lower, dim1=-2, dim2=-1).log().sum(-1)
        mass, place, lower = (part.unflatten(0, (starts, G)).movedim(1, 0) for part in (mass, found.z, lower))
        weight = torch.log_softmax(mass, -1) + math.log1p(-UNIFORM)
        everywhere = torch.eye(P).to(lower).expand(G, 1, P, P)
        return TruncatedMixture(
            torch.cat([weight, torch.full_like(weight[:, :1], math.log(UNIFORM))], 1),
            torch.cat([place, torch.full_like(place[:, :1], 0.5)], 1),
            torch.cat([lower, everywhere], 1),
            self.box,
        )


class _Likelihood:
    """Log p of a set of trajectories."""

    def __init__(self, model: SimulatorFilter, rows: Rows, box: Box) -> None:
        self._model, self._rows, self.box = model, rows, box

    @torch.no_grad()
    def __call__(self, theta: Float[Tensor, "N P"]) -> Float[Tensor, " N"]:
        n = len(self._rows.mask)
        found = []
        for z in self.box.to_frame(theta).to(self._rows.first).split(max(1, AT_ONCE // n)):
            many = Rows(*(part.repeat(len(z), *[1] * (part.ndim - 1)) for part in self._rows))
            found.append(self._model.log_likelihood(many, z.repeat_interleave(n, 0)).reshape(-1, n).sum(1))
        return torch.cat(found)


class LikelihoodPosterior:
    """A posterior known by weighted draws, with the density of any theta by the likelihood.

    Args:
        likelihood: theta (N, P) -> log likelihood (N,).
        draws: of the posterior.
    """

    def __init__(self, likelihood: _Likelihood, draws: WeightedDraws) -> None:
        self.box, self.space = draws.box, draws.box.space
        self._likelihood, self._draws = likelihood, draws

    @property
    def effective(self) -> float:
        """Effective number of draws: with fewer than some tens the posterior is not to be trusted."""
        return self._draws.effective

    @property
    def log_evidence(self) -> float:
        """log Z, against the uniform density on the box."""
        return self._draws.log_mass

    def log_prob(self, theta: Float[Tensor, "*shape P"]) -> Float[Tensor, "*shape"]:
        """Log density at theta [1 / units], which lies where theta does; -inf outside the box."""
        inside = self.box.contains(theta)
        theta = torch.where(inside.unsqueeze(-1), theta, self.space.from_unit(self.box.low.to(theta)))
        values = self._likelihood(theta.reshape(-1, theta.shape[-1])).reshape(theta.shape[:-1]).to(theta.device)
        return torch.where(inside, values - self.log_evidence + self.box.log_abs_det(theta), -torch.inf)

    def sample(self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None) -> Tensor:
        """Theta (*shape, P): draws picked anew by their weights."""
        chosen = choose(self._draws.weight.log()[None], torch.Size(shape).numel(), generator)[0]
        return self.box.from_frame(self._draws.z[chosen]).reshape(*shape, len(self.space))

    def credibility(self, theta: Float[Tensor, " P"]) -> float:
        """Of the smallest region that holds theta, by the draws that there are; see ``calibration``."""
        truth = float(self.log_prob(theta) - self.box.log_abs_det(theta) + self.log_evidence)
        return float((self._draws.weight * (self._draws.log_density >= truth)).sum())


class LikelihoodPosteriors:
    """A batch (G,) of posteriors."""

    def __init__(self, members: Sequence[LikelihoodPosterior]) -> None:
        self._members = tuple(members)

    @property
    def batch_shape(self) -> torch.Size:
        """(G,)."""
        return torch.Size([len(self._members)])

    def __getitem__(self, index: int) -> LikelihoodPosterior:
        """One of the batch."""
        return self._members[index]

    @property
    def effective(self) -> Float[Tensor, " G"]:
        """Effective number of draws of each."""
        return torch.tensor([one.effective for one in self._members])

    def log_prob(self, theta: Float[Tensor, "*shape P"]) -> Float[Tensor, "*out"]:
        """Log density at theta (*sample, G, P) or (P) [1 / units]."""
        theta = theta.expand(*theta.shape[: max(theta.ndim - 2, 0)], len(self._members), theta.shape[-1])
        return torch.stack([one.log_prob(theta[..., g, :]) for g, one in enumerate(self._members)], -1)

    def sample(self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None) -> Tensor:
        """Theta (*shape, G, P)."""
        return torch.stack([one.sample(shape, generator) for one in self._members], -2)

    def credibility(self, theta: Float[Tensor, "G P"]) -> Float[Tensor, " G"]:
        """Of each; see :meth:`LikelihoodPosterior.credibility`."""
        return torch.tensor([one.credibility(each) for one, each in zip(self._members, theta, strict=True)])
