"""The columns of the thesis's tables: ways to a posterior from the same simulations and the same measured rollouts.

    sets (G, n, T) ~ theta_g ~ p, n rollouts each;    measured (n, T), n rollouts of the true system

| column                  | what it reads                                 | simulations            |
|-------------------------|-----------------------------------------------|------------------------|
| rejection ABC           | statistics, simulated ones of one rollout     | one rollout of a set   |
| population ABC          | the same, as nearer and nearer ones are drawn | as many rollouts anew  |
| epsilon-free            | statistics averaged over n rollouts           | as many sets, 4 rounds |
| network as published    | the same                                      | all sets               |
| network, ten as one     | averages, read as if they were of one rollout | one rollout of a set   |
| Fourier features        | the same; length scale by cross-validation    | all sets               |
| LSTM                    | each rollout by itself, multiplied            | ``ALONE`` rollouts     |
| filter                  | n rollouts through the simulator's filter     | ``ALONE`` rollouts     |

Statistics are those of Eq 4.20. "Ten as one" is the thesis's use of averages, in Table 4.1 only. The filter is what the
classic recipes use; it needs the simulator's equations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.embeddings import (
    Embedding,
    FilteredEmbedding,
    LSTMEmbedding,
    PooledEmbedding,
    StatisticsEmbedding,
    TransitionFeatures,
)
from onlinebayes.inference import (
    Belief,
    BoxUniform,
    EpsilonFree,
    FourierFeatures,
    MixtureEstimator,
    NeuralEstimator,
    NeuralPosteriorLoss,
    PopulationABC,
    RejectionABC,
    fit,
    length_scales,
)
from onlinebayes.inference.length_scale import cross_validate
from onlinebayes.inference.neural import mixture_of
from recipes.studies.thesis.published import PublishedNetwork

FEATURES, ALONE, BATCH, CHECKED, CHOSEN_BY, FOLDS = 200, 600, 500, 64, 300, 2
TRAIN = partial(fit, epochs=60, batch_size=100, learning_rate=2e-3)
CHOOSE = partial(fit, epochs=20, batch_size=100, learning_rate=2e-3)
"""For a candidate's length scale, on ``CHOSEN_BY`` sets: candidates are told apart long before they are learnt."""
LSTM_TRAIN = partial(fit, epochs=25, batch_size=50, learning_rate=4e-3)
FILTER_TRAIN = partial(fit, epochs=25, batch_size=50, learning_rate=1e-3)

Simulate = Callable[[Tensor, torch.Generator, int], TensorDict]
"""(theta (B, P), generator, n) -> sets of n rollouts (B, n, T)."""


@dataclass(frozen=True)
class Data:
    """One system, simulated and measured.

    Args:
        prior: uniform on a box.
        sets: simulated (G, n, T), with their theta.
        measured: (n, T), without theta.
        simulate: more of the same.
        filtered: a fresh embedding by the filter, where there is one.
    """

    prior: BoxUniform
    sets: TensorDict
    measured: TensorDict
    simulate: Simulate
    filtered: Callable[[], FilteredEmbedding] | None

    @property
    def features(self) -> TransitionFeatures:
        """Of transitions, without a simulator."""
        return TransitionFeatures(self.sets["observation"].shape[-1], self.sets["action"].shape[-1])

    @property
    def averages(self) -> Embedding:
        """Statistics, averaged over a set."""
        return PooledEmbedding(StatisticsEmbedding(self.features))


Column = Callable[[Data, torch.Generator], Belief]


def rejection(data: Data, draw: torch.Generator) -> Belief:
    """The nearest two per cent."""
    estimator = RejectionABC(StatisticsEmbedding(data.features), data.prior.space)
    estimator.fit(data.sets[:, 0], generator=draw)
    return estimator.condition(data.measured)


def population(data: Data, draw: torch.Generator) -> Belief:
    """A cloud that moves to where simulations look alike."""

    def simulate(theta: Tensor, generator: torch.Generator) -> TensorDict:
        return data.simulate(theta, generator, 1)[:, 0]

    groups, n = data.sets.shape[:2]
    embedding = StatisticsEmbedding(data.features)
    sampler = PopulationABC(embedding, data.prior, simulate, batch=BATCH, simulations=groups * n)
    return sampler.run(data.measured, draw).belief


def epsilon_free(data: Data, draw: torch.Generator) -> Belief:
    """Two Gaussian rounds, a mixture, and a round more where the correction is refused."""
    groups, n = data.sets.shape[:2]

    def simulate(theta: Tensor, generator: torch.Generator) -> TensorDictBase:
        return data.simulate(theta, generator, n)

    sampler = EpsilonFree(lambda _: data.averages, data.prior, simulate, rounds=2, simulations=groups // 4, train=TRAIN)
    return sampler.run(data.measured[None], draw).belief


def published(data: Data, draw: torch.Generator) -> Belief:
    """The network that the thesis prints."""
    embedding = data.averages
    network = PublishedNetwork(data.prior.space, embedding.size)
    return learnt(data, NeuralPosteriorLoss(embedding, network, whole_sets=True), draw)


def ten_as_one(data: Data, draw: torch.Generator) -> Belief:
    """The same network, learnt from single rollouts and asked about an average, which is no draw from them."""
    embedding = StatisticsEmbedding(data.features)
    network = PublishedNetwork(data.prior.space, embedding.size)
    loss = NeuralPosteriorLoss(embedding, network)
    TRAIN(loss, data.sets[:, 0], generator=draw)
    with torch.no_grad():
        return network.distribution(loss.embed(data.measured).mean(0, keepdim=True))[0]


def fourier(data: Data, draw: torch.Generator) -> Belief:
    """Random features of the Matern 5/2 kernel."""

    def make(length_scale: float) -> NeuralPosteriorLoss:
        embedding = data.averages
        trunk = FourierFeatures(embedding.size, FEATURES, length_scale=length_scale)
        network = MixtureEstimator(data.prior.space, embedding.size, hidden=FEATURES, trunk=trunk, diagonal=True)
        return NeuralPosteriorLoss(embedding, network, whole_sets=True)

    candidates = length_scales(make(1.0), data.sets)
    found = cross_validate(make, data.sets[:CHOSEN_BY], candidates, generator=draw, folds=FOLDS, train=CHOOSE)
    return learnt(data, make(found.length_scale), draw)


def learnt(data: Data, loss: NeuralPosteriorLoss, draw: torch.Generator) -> Belief:
    """Of a loss that learns from whole sets."""
    estimator = NeuralEstimator(loss, TRAIN)
    estimator.fit(data.sets, generator=draw)
    return estimator.condition(data.measured)


def recurrent(data: Data, draw: torch.Generator) -> Belief:
    """An LSTM that learns with the mixture; its posteriors are multiplied, as wide as held-out sets ask for."""
    estimator = mixture_of(LSTMEmbedding(data.features), data.prior, LSTM_TRAIN)
    estimator.fit(alone(data.sets), data.sets[-CHECKED:], generator=draw)
    return estimator.condition(data.measured)


def filtered(data: Data, draw: torch.Generator) -> Belief:
    """The filter through the simulator."""
    assert data.filtered is not None
    estimator = mixture_of(data.filtered(), data.prior, FILTER_TRAIN)
    estimator.fit(alone(data.sets), generator=draw)
    return estimator.condition(data.measured)


def alone(sets: TensorDict) -> TensorDict:
    """Single rollouts of all places in a set, none of those that are held out."""
    learnt_from = sets[:-CHECKED]
    index = torch.arange(ALONE)
    return learnt_from[index % len(learnt_from), index % sets.shape[1]]


COLUMNS: dict[str, Column] = {
    "rejection ABC": rejection,
    "population ABC": population,
    "epsilon-free": epsilon_free,
    "network as published": published,
    "Fourier features": fourier,
    "LSTM": recurrent,
}
TEN_AS_ONE, FILTER, CEILING = "network, ten as one", "filter", "ceiling"


def beliefs(data: Data, seed: int, columns: Mapping[str, Column]) -> dict[str, Belief]:
    """These columns, and the filter's where there is one, each from the same first weights and draws."""
    found = {}
    for name, column in {**columns, **({FILTER: filtered} if data.filtered is not None else {})}.items():
        torch.manual_seed(seed)
        found[name] = column(data, torch.Generator().manual_seed(seed))
    return found
