"""Population Monte-Carlo ABC: a cloud of parameters that is moved, round by round, to where simulations look alike.

    round 0     theta_i ~ p;                     the n nearest of m simulations stay
    round t     eps_t = a quantile of the distances that stay,    S_t = 2 x the cloud's weighted covariance
                theta* ~ sum_j w_j N(theta_j, S_t) within the box, kept if d(theta*) <= eps_t, until there are n
                w_i proportional to p(theta_i) / sum_j w_j N(theta_i; theta_j, S_t)

The kernel and the tolerance adapt as in Beaumont, Cornuet, Marin and Robert (2009) and Del Moral, Doucet and Jasra
(2012). Proposals are simulated a batch at a time, all worlds at once. It ends when the simulations are spent, or when a
round keeps too few of a batch. Each measured system needs a run of its own: nothing is learnt for the next one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from tensordict import TensorDictBase
from torch import Tensor

from onlinebayes.embeddings import Embedding
from onlinebayes.inference.distributions import BoxUniform, TruncatedMixture
from onlinebayes.inference.trajectories import TrajectoryKeys
from onlinebayes.runs import BadInput, heed

Simulate = Callable[[Float[Tensor, "B P"], torch.Generator], TensorDictBase]
"""(theta, generator) -> trajectories (B, T). Theta lies where the generator does, the trajectories anywhere."""

LEAST_KEPT = 0.005
"""Of a batch: a round that keeps fewer costs more than it tells."""

THINNEST = 1e-8
"""Of the box's width, squared: the cloud's least variance."""


@dataclass(frozen=True, eq=False)
class Population:
    """Result of a run.

    Args:
        belief: the weighted cloud, smoothed.
        tolerances: eps of each round.
        simulations: how many were made.
        effective: 1 / sum w^2, the number of equally weighted particles that the cloud is worth.
    """

    belief: TruncatedMixture
    tolerances: tuple[float, ...]
    simulations: int
    effective: float


@dataclass(frozen=True)
class PopulationABC:
    """A sampler of the posterior of one measured system.

    Args:
        embedding: without weights; it is standardised on the first batch.
        prior: uniform on a box.
        simulate: see :data:`Simulate`.
        particles: n.
        batch: simulations at once.
        simulations: budget of a run.
        quantile: of the distances, the next tolerance.
        keys: where trajectories lie in a TensorDict.

    Raises:
        BadInput: an embedding that has to be trained; numbers that are none; a batch smaller than the cloud.
    """

    embedding: Embedding
    prior: BoxUniform
    simulate: Simulate
    particles: int = 200
    batch: int = 1000
    simulations: int = 20_000
    quantile: float = 0.5
    keys: TrajectoryKeys = field(default_factory=TrajectoryKeys)

    def __post_init__(self) -> None:
        if any(True for _ in self.embedding.parameters()):
            raise BadInput("the embedding has weights, and ABC trains none", "give a SummaryEmbedding")
        if not (0 < self.quantile < 1 and 2 <= self.particles <= self.batch <= self.simulations):
            raise BadInput(
                f"quantile {self.quantile:g}, {self.particles} particles, batch {self.batch}, "
                f"{self.simulations} simulations",
                "needs 0 < quantile < 1 and 2 <= particles <= batch <= simulations",
            )
        self.embedding.double()

    def run(self, measured: TensorDictBase, generator: torch.Generator) -> Population:
        """The posterior given trajectories (n, T) of one system, compared by their mean summaries.

        Args:
            measured: the trajectories.
            generator: decides all draws.
        """
        cloud, spent = _Cloud.first(self, measured, generator), self.batch
        tolerances = [float(cloud.distance.max())]
        while spent + self.batch <= self.simulations:
            tolerance = float(cloud.distance.quantile(self.quantile))
            moved, used = self._moved(cloud, tolerance, self.simulations - spent, generator)
            spent += used
            if moved is None:
                break
            cloud = moved
            tolerances.append(tolerance)
        effective = 1 / float(cloud.weight.square().sum())
        return Population(cloud.smoothed(self.prior, effective), tuple(tolerances), spent, effective)

    def _moved(
        self, cloud: _Cloud, tolerance: float, most: int, generator: torch.Generator
    ) -> tuple[_Cloud | None, int]:
        """The next cloud, None where the simulations are spent before it is full; and how many were made."""
        z, distance, used = cloud.z[:0], cloud.distance[:0], 0
        lower = cloud.kernel()
        while len(z) < self.particles:
            heed()
            if used + self.batch > most:
                return None, used
            proposed = cloud.proposed(lower, self.batch, generator)
            found = cloud.distances(self, proposed, generator)
            used += self.batch
            kept = found <= tolerance
            if float(kept.double().mean()) < LEAST_KEPT:
                return None, used
            z, distance = torch.cat([z, proposed[kept]]), torch.cat([distance, found[kept]])
        z, distance = z[: self.particles], distance[: self.particles]
        return _Cloud(z, _weights(z, cloud, lower), distance, cloud.observed), used


@dataclass(frozen=True, eq=False)
class _Cloud:
    """Particles in the box's coordinates, their weights and distances; and the measurement's summaries."""

    z: Float[Tensor, "N P"]
    weight: Float[Tensor, " N"]
    distance: Float[Tensor, " N"]
    observed: Float[Tensor, " E"]

    @classmethod
    def first(cls, sampler: PopulationABC, measured: TensorDictBase, generator: torch.Generator) -> _Cloud:
        """The nearest of a batch of the prior's."""
        theta = sampler.prior.sample((sampler.batch,), generator)
        like = torch.zeros((), dtype=torch.float64, device=sampler.embedding.device)
        simulations = sampler.simulate(theta, generator)
        recorded = sampler.keys.recorded(simulations)
        if int(recorded.sum()) < sampler.particles:
            raise BadInput(
                f"{int(recorded.sum())} of {sampler.batch} simulations have a recorded step",
                f"{sampler.particles} particles need as many: narrow the prior, or take a larger batch",
            )
        sampler.embedding.fit(*sampler.keys.read(sampler.keys.usable(simulations), like))
        observed = sampler.embedding(*sampler.keys.read(measured, like)).mean(0)
        distance = _distances(sampler, simulations, observed)
        nearest = distance.topk(sampler.particles, largest=False)
        z = sampler.prior.box.to_frame(theta.to(like))[nearest.indices]
        weight = torch.full_like(nearest.values, 1 / sampler.particles)
        return cls(z, weight, nearest.values, observed)

    def distances(
        self, sampler: PopulationABC, z: Float[Tensor, "B P"], generator: torch.Generator
    ) -> Float[Tensor, " B"]:
        """Of fresh simulations."""
        theta = sampler.prior.box.from_frame(z).to(generator.device)
        return _distances(sampler, sampler.simulate(theta, generator), self.observed)

    def covariance(self) -> Float[Tensor, "P P"]:
        """Weighted."""
        centred = self.z - self.weight @ self.z
        return (centred * self.weight[:, None]).T @ centred

    def kernel(self) -> Float[Tensor, "P P"]:
        """Cholesky factor of S."""
        size = self.z.shape[1]
        return torch.linalg.cholesky(2 * self.covariance() + THINNEST * torch.eye(size).to(self.z))

    def proposed(self, lower: Float[Tensor, "P P"], number: int, generator: torch.Generator) -> Float[Tensor, "B P"]:
        """Moved particles inside the box; those that leave it are drawn anew."""
        found, drawn_on = self.z[:0], generator.device
        weight = self.weight.to(drawn_on)
        while len(found) < number:
            which = torch.multinomial(weight, 2 * number, replacement=True, generator=generator)
            noise = torch.randn(2 * number, lower.shape[0], dtype=lower.dtype, device=drawn_on, generator=generator)
            moved = self.z[which.to(self.z.device)] + noise.to(lower) @ lower.T
            found = torch.cat([found, moved[((moved >= 0) & (moved <= 1)).all(-1)]])
        return found[:number]

    def smoothed(self, prior: BoxUniform, effective: float) -> TruncatedMixture:
        """A kernel of Silverman's width at each particle."""
        N, P = self.z.shape
        factor = (4 / (effective * (P + 2))) ** (1 / (P + 4))
        floor = THINNEST * torch.eye(P).to(self.z)
        lower = torch.linalg.cholesky(factor**2 * self.covariance() + floor).expand(N, P, P)
        return TruncatedMixture(self.weight.log(), self.z, lower, prior.box)


def _distances(sampler: PopulationABC, simulations: TensorDictBase, observed: Float[Tensor, " E"]) -> Tensor:
    """Of each simulation (B,); one without a recorded step is infinitely far."""
    recorded = sampler.keys.recorded(simulations).to(observed.device)
    vectors = sampler.embedding(*sampler.keys.read(sampler.keys.usable(simulations), observed))
    return observed.new_full((len(recorded),), torch.inf).masked_scatter(recorded, (vectors - observed).norm(dim=-1))


def _weights(z: Float[Tensor, "N P"], before: _Cloud, lower: Float[Tensor, "P P"]) -> Float[Tensor, " N"]:
    """1 / density of what proposed them, the prior being flat, normalised."""
    away = (z[:, None] - before.z).flatten(0, 1)
    standard = torch.linalg.solve_triangular(lower, away.T, upper=False).T.unflatten(0, (len(z), len(before.z)))
    log_kernel = -0.5 * standard.square().sum(-1)
    log_density = torch.logsumexp(before.weight.clamp_min(math.ulp(0.0)).log() + log_kernel, dim=1)
    return torch.softmax(-log_density, dim=0)
