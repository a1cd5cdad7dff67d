"""Neural posterior estimation behind the estimator protocol, with a product of posteriors that is calibrated.

    q(theta | x)  by maximum likelihood on simulations
    q(theta | x_1 ... x_n)  prop. to  prod_i q_w(theta | x_i)

q_w is q with every component's scale times w. Calibrated single posteriors do not make a calibrated product: what they
have in common, an error of the network, is counted n times in it. The factor w is found on held-out groups, n
simulated trajectories of one theta each: of those w with which the 95 % region holds 95 % of the groups' truths, the
one with the highest mean log density of the truth. Where no w does so, or the network's densities have no product,
the union of the n posteriors is taken. An embedding of sets needs none of this: its posterior is one density, given
all n.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

import torch
from tensordict import TensorDictBase

from onlinebayes.embeddings import Embedding, SetEmbedding
from onlinebayes.inference.alarm import Alarm
from onlinebayes.inference.base import Belief, DensityBatch, FitReport, Multipliable
from onlinebayes.inference.calibration import credibility_of
from onlinebayes.inference.estimator import MixtureEstimator
from onlinebayes.inference.fit import fit
from onlinebayes.inference.loss import NeuralPosteriorLoss
from onlinebayes.inference.posterior import Posterior
from onlinebayes.inference.trajectories import frame_of
from onlinebayes.runs import heed

FACTORS = (1.0, 1.25, 1.6, 2.0, 2.5, 3.2, 4.0)
"""Candidates for w: a fifth apart, a step that costs less than .03 nats a parameter."""

LEVEL = 0.95
"""Of the region that has to hold as many of the held-out truths."""

Fit = Callable[..., FitReport]
"""(loss, simulations, generator=...) -> report; :func:`~onlinebayes.inference.fit` with its arguments bound."""

TRAIN: Fit = partial(fit, epochs=25, batch_size=50, learning_rate=4e-3)
"""Enough for a thousand simulations of one round."""


class NeuralEstimator:
    """A :class:`~onlinebayes.inference.PosteriorEstimator` made of a loss and a way to train it.

    Args:
        loss: embedding and estimator network.
        train: see :data:`Fit`.

    Attributes:
        space, box: of the estimator network.
        combination: w, inf for the union; before :meth:`fit` 1, where there is a product.
    """

    def __init__(self, loss: NeuralPosteriorLoss, train: Fit = fit) -> None:
        self.loss, self._train = loss, train
        self.space, self.box = loss.estimator.space, loss.estimator.box
        self.combination = 1.0 if isinstance(loss.estimator, Multipliable) else math.inf

    def fit(
        self, simulations: TensorDictBase, groups: TensorDictBase | None = None, *, generator: torch.Generator
    ) -> FitReport:
        """Train the loss, then find w on the groups (G, n, T); see :class:`PosteriorEstimator`."""
        report = self._train(self.loss, simulations, generator=generator)
        if isinstance(self.loss.estimator, Multipliable):
            self.combination = 1.0
        if groups is not None:
            self.calibrate(groups, generator=generator)
        report.combination = self.combination
        return report

    def calibrate(self, groups: TensorDictBase, *, generator: torch.Generator) -> None:
        """Find w for another number n of trajectories, on groups (G, n, T); the network stays as it is."""
        together = isinstance(self.loss.embedding, SetEmbedding)
        if isinstance(self.loss.estimator, Multipliable) and groups.shape[1] > 1 and not together:
            self.combination = self._best_combination(groups, generator)

    def condition(self, trajectories: TensorDictBase) -> Posterior:
        """The posterior given trajectories (n, T) of one system."""
        posterior = Posterior(self.loss)
        if math.isinf(self.combination):
            return posterior.condition(trajectories)
        return posterior.condition(trajectories, combine="product", widening=self.combination)

    def alarm(self, simulations: TensorDictBase) -> Alarm:
        """An alarm over what its embedding makes of these simulations (B, T)."""
        return Alarm(self.loss.embedding, simulations, self.loss.keys)

    def tails(self, trajectories: TensorDictBase, begins: Sequence[int]) -> list[Belief]:
        """Return the posterior of trajectories (n, T) from each number on; sets in one batch, shorter ones masked."""
        if not isinstance(self.loss.embedding, SetEmbedding):
            return [self.condition(trajectories[begin:]) for begin in begins]
        keys, n = self.loss.keys, trajectories.shape[0]
        mask = keys.mask_of(trajectories)
        sets = trajectories.expand(len(begins), *trajectories.shape).clone()
        after = torch.arange(n, device=mask.device) >= torch.tensor(list(begins), device=mask.device)[:, None]
        told = Posterior(self.loss).of_sets(sets.set(keys.mask, mask & after[..., None]))
        return [self.loss.estimator.united([told[i]]) for i in range(len(begins))]

    @torch.no_grad()
    def each(self, groups: TensorDictBase) -> DensityBatch:
        """G posteriors, one for each group of n trajectories (G, n, T)."""
        return self._combined(self._told(groups), self.combination)

    @torch.no_grad()
    def _best_combination(self, groups: TensorDictBase, generator: torch.Generator) -> float:
        told, theta = self._told(groups), self.loss.keys.read_theta(groups[:, 0]).double()
        frame_of(theta, self.box)  # refuses what would count as a miss of every w
        scores = {}
        for factor in FACTORS:
            heed()
            posterior = self._combined(told, factor)
            alpha = credibility_of(posterior, theta, samples=500, generator=generator)
            if float((alpha <= LEVEL).double().mean()) >= LEVEL:
                scores[factor] = float(posterior.log_prob(theta).mean())
        return max(scores, key=scores.__getitem__, default=math.inf)

    def _told(self, groups: TensorDictBase) -> list[DensityBatch]:
        """The n posteriors of the groups' members, each a batch (G,); one of them all by an embedding of sets."""
        posterior = Posterior(self.loss)
        if isinstance(self.loss.embedding, SetEmbedding):
            return [posterior.of_sets(groups)]
        return [posterior.each(groups[:, i]) for i in range(groups.shape[1])]

    def _combined(self, told: list[DensityBatch], factor: float) -> DensityBatch:
        estimator = self.loss.estimator
        if isinstance(estimator, Multipliable) and not math.isinf(factor):
            return estimator.multiplied(told, factor)
        return estimator.united(told)


def mixture_of(embedding: Embedding, proposal: Belief, train: Fit = TRAIN) -> NeuralEstimator:
    """A mixture density network behind an embedding, where that lies, in the box of a proposal."""
    located = isinstance(embedding, SetEmbedding) and embedding.located
    network = MixtureEstimator(proposal.space, embedding.size, box=proposal.box, located=located)
    return NeuralEstimator(NeuralPosteriorLoss(embedding, network.to(embedding.device)), train)
