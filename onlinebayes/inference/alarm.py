"""Is a measurement like anything that was simulated? Where it is not, no posterior of it means anything.

    d(x) = mean distance from e(x) to the k nearest other simulations,      e whitened summaries
    p(x) = (1 + number of simulations i with d(x_i) >= d(x)) / (N + 1)

p is uniform where the measurement comes from the simulator, at any theta under the prior (its rank among the
simulations is), and small where it does not: the nearest-neighbour novelty score of Ramaswamy, Rastogi and Shim (2000),
as a conformal p-value (Bates et al. 2023). Several trajectories of one system share their theta, so that their p are
not independent: n times the smallest one is taken (Bonferroni).

What differs is told by the summaries that lie farthest out, in standard deviations of the nearest simulations.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from tensordict import TensorDictBase
from torch import Tensor

from onlinebayes.embeddings import Embedding
from onlinebayes.inference.trajectories import TrajectoryKeys
from onlinebayes.runs import BadInput

NEIGHBOURS = 10
"""k."""

NEAR = 50
"""Simulations that a measurement is compared with, summary by summary."""

FEWEST = 100
"""Simulations: p cannot be smaller than a hundredth with fewer."""


@dataclass(frozen=True, eq=False)
class Surprise:
    """Difference of a measurement from the simulations.

    Args:
        p: as above; below .05 the model can hardly have made this.
        away: how far each summary lies from the nearest simulations' mean [their standard deviations], for the
            trajectory that is strangest.
    """

    p: float
    away: Float[Tensor, " E"]

    def __bool__(self) -> bool:
        return self.p < 0.05

    @property
    def farthest(self) -> tuple[int, ...]:
        """Numbers of the summaries, the one that lies farthest out first."""
        return tuple(self.away.abs().argsort(descending=True).tolist())


class Novelty:
    """Compares the summaries of measurements with those of simulations.

    Args:
        summaries: e of the simulations.

    Raises:
        BadInput: fewer than a hundred simulations.
    """

    def __init__(self, summaries: Float[Tensor, "N E"]) -> None:
        if len(summaries) < FEWEST:
            raise BadInput(f"{len(summaries)} simulations", f"an alarm needs {FEWEST} or more")
        self._centre, self._whitening = _whitening(summaries)
        if not self._whitening.shape[1]:
            raise BadInput("all simulations have the same summaries", "an alarm needs some that vary with theta")
        self._simulated = (summaries - self._centre) @ self._whitening
        apart = torch.cdist(self._simulated, self._simulated)
        apart.fill_diagonal_(torch.inf)
        self._scores = _score(apart)

    def check(self, measured: Float[Tensor, "n E"]) -> Surprise:
        """Test how unlike the simulations the summaries of n trajectories of one system are."""
        e = (measured - self._centre) @ self._whitening
        apart = torch.cdist(e, self._simulated)
        scores = _score(apart)
        p = (1 + (self._scores >= scores[:, None]).sum(1)) / (len(self._scores) + 1)
        strangest = int(p.argmin())
        near = self._simulated[apart[strangest].topk(NEAR, largest=False).indices]
        # Back from whitened coordinates: each summary is told as it is.
        unwhitened = torch.linalg.pinv(self._whitening)
        values, nearest = e[strangest] @ unwhitened, near @ unwhitened
        spread = nearest.std(0)
        away = torch.where(spread > 0, (values - nearest.mean(0)) / spread.clamp_min(1e-300), 0.0)
        return Surprise(min(1.0, len(p) * float(p.min())), away)


class Alarm:
    """Compares measurements with simulations, by what an embedding makes of them.

    Args:
        embedding: fitted on the simulations; what it drops is not compared.
        simulations: trajectories (B, T) from the prior, or from the proposal that the posterior is asked under.
        keys: where trajectories lie in a TensorDict.

    Raises:
        BadInput: fewer than a hundred simulations with a recorded step, or summaries that do not vary at all.
    """

    def __init__(self, embedding: Embedding, simulations: TensorDictBase, keys: TrajectoryKeys | None = None) -> None:
        self._embedding, self._keys = embedding, keys if keys is not None else TrajectoryKeys()
        self._like = next(iter([*embedding.parameters(), *embedding.buffers()]))
        self._novelty = Novelty(self._summaries(self._keys.usable(simulations)))

    def check(self, measured: TensorDictBase) -> Surprise:
        """Test how unlike the simulations the trajectories (n, T) of one system are."""
        return self._novelty.check(self._summaries(measured))

    def each(self, measured: TensorDictBase) -> list[Surprise]:
        """Test each of B trajectories (B, T) by itself."""
        return [self._novelty.check(row[None]) for row in self._summaries(measured)]

    def _summaries(self, trajectories: TensorDictBase) -> Float[Tensor, "B E"]:
        with torch.no_grad():
            return self._embedding(*self._keys.read(trajectories, self._like)).double()


def _score(apart: Float[Tensor, "B N"]) -> Float[Tensor, " B"]:
    return apart.topk(NEIGHBOURS, largest=False).values.mean(1)


def _whitening(summaries: Float[Tensor, "N E"]) -> tuple[Float[Tensor, " E"], Float[Tensor, "E D"]]:
    """Mean, and what turns summaries into D uncorrelated ones of variance 1; what does not vary is dropped."""
    centre = summaries.mean(0)
    _, singular, vectors = torch.linalg.svd(summaries - centre, full_matrices=False)
    sd = singular / len(summaries) ** 0.5
    kept = sd > 1e-6 * sd.max().clamp_min(1e-300)
    return centre, (vectors[kept] / sd[kept, None]).T
