"""The length scale of Fourier features, by cross-validation: the one whose fits give held-out theta the most density.

    l* = argmin_l  mean over folds f of  - log q_l,f(theta_b | x_b),   b in fold f,   q_l,f fitted to the other folds

The candidates stand about the median distance between embeddings (Gretton et al. 2012): far below it every embedding is
a stranger to every other, far above it all look alike.

    def make(length_scale):
        trunk = FourierFeatures(embedding.size, 500, length_scale=length_scale)
        network = MixtureEstimator(space, embedding.size, hidden=500, trunk=trunk)
        return NeuralPosteriorLoss(copy.deepcopy(embedding), network)

    scales = length_scales(make(1.0), simulations)
    choice = cross_validate(make, simulations, scales, generator=g)
    loss = make(choice.length_scale)                                # and fit it to all simulations
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from tensordict import TensorDictBase

from onlinebayes.inference.loss import NeuralPosteriorLoss
from onlinebayes.inference.neural import TRAIN, Fit
from onlinebayes.runs import BadInput

FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Of the median distance: the loss is flat within a factor of two."""

PAIRED = 1000
"""Embeddings between which distances are taken: their median errs by a few per cent."""


@dataclass(frozen=True)
class LengthScaleChoice:
    """Result of the cross-validation.

    Attributes:
        length_scale: the best; where it is the first or the last of the candidates, look beyond it.
        losses: mean held-out loss of each candidate [nats].
    """

    length_scale: float
    losses: dict[float, float]


@torch.no_grad()
def length_scales(
    loss: NeuralPosteriorLoss, simulations: TensorDictBase, factors: Sequence[float] = FACTORS
) -> list[float]:
    """Candidates: the median distance between the embeddings of the simulations, times each factor.

    Args:
        loss: its embedding is standardised on the simulations. One that is trained is taken as it is: its distances
            change with training.
        simulations: trajectories (B, T), or sets of them (B, n, T).
        factors: see :data:`FACTORS`.

    Raises:
        BadInput: more than half of the embeddings are the same.
    """
    loss.standardise(simulations)
    vectors = loss.embed(simulations)
    median = float(torch.pdist(vectors[:: -(-len(vectors) // PAIRED)]).nanmedian())
    if not median > 0:
        raise BadInput(
            f"the median distance between {len(vectors)} embeddings is {median:g}",
            "give two simulations or more, and an embedding that tells them apart",
        )
    return [factor * median for factor in factors]


def cross_validate(
    make: Callable[[float], NeuralPosteriorLoss],
    simulations: TensorDictBase,
    candidates: Sequence[float],
    *,
    generator: torch.Generator,
    folds: int = 3,
    train: Fit = TRAIN,
) -> LengthScaleChoice:
    """Fit every candidate to all folds but one, in turns, and compare the losses on the one.

    Args:
        make: length scale -> a fresh loss. The weights of all candidates begin alike.
        simulations: trajectories (B, T) with their theta.
        candidates: length scales, in units of the embeddings.
        generator: decides folds, first weights and the order of the batches, the same for all candidates.
        folds: number of folds.
        train: how a loss is trained.

    Raises:
        BadInput: no candidate, or fewer than three simulations a fold.
    """
    rows = simulations.shape[0]
    if not candidates or folds < 2 or rows < 3 * folds:
        raise BadInput(
            f"{len(candidates)} length scales, {folds} folds of {rows} simulations",
            "needs one length scale, two folds and three simulations a fold, at least",
        )
    order = torch.randperm(rows, generator=generator, device=generator.device).cpu()
    seeds = torch.randint(2**31, (folds,), generator=generator, device=generator.device).tolist()
    totals = dict.fromkeys(candidates, 0.0)
    for held, seed in zip(order.tensor_split(folds), seeds, strict=True):
        kept = torch.ones(rows, dtype=torch.bool)
        kept[held] = False
        for candidate in totals:
            with torch.random.fork_rng(devices=[]):
                torch.manual_seed(seed)
                loss = make(candidate)
            train(loss, simulations[kept], generator=torch.Generator(generator.device).manual_seed(seed))
            with torch.no_grad():
                totals[candidate] += float(loss.each(loss.prepare(simulations[held])).sum()) / rows
    return LengthScaleChoice(min(totals, key=totals.__getitem__), totals)
