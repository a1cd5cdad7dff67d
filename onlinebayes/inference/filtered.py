"""The estimator for noisy sensors: each trajectory told by what a Kalman filter through the simulator makes of it.

    x -> filter over (state, theta) -> mean and covariance of theta -> mixture density network -> q(theta | x)

    estimator = filtered_estimator(simulator, task, state=...)      # proposal -> a fresh estimator in its box

It asks for the same as :func:`~onlinebayes.inference.residual_estimator`, whose residuals are taken one step ahead from
a noisy observation; this one is sharper under noise (see :class:`~onlinebayes.embeddings.FilteredEmbedding`), and has
no use for actions and observations that the simulator does not explain.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.embeddings import FilteredEmbedding
from onlinebayes.inference.base import Belief, PosteriorEstimator
from onlinebayes.inference.estimator import MixtureEstimator
from onlinebayes.inference.fit import fit
from onlinebayes.inference.loss import NeuralPosteriorLoss
from onlinebayes.inference.neural import Fit, NeuralEstimator
from onlinebayes.simulators import Simulator, Task

TRAIN: Fit = partial(fit, epochs=25, batch_size=50, learning_rate=4e-3)


def filtered_estimator(
    simulator: Simulator,
    task: Task,
    *,
    state: Callable[[Tensor], TensorDict],
    observe: Callable[[TensorDictBase], Any] | None = None,
    train: Fit = TRAIN,
) -> Callable[[Belief], PosteriorEstimator]:
    """What a trainer asks for: proposal -> a fresh estimator in the proposal's box.

    Args:
        simulator: whose parameters are inferred.
        task: what is commanded and observed.
        state: observations (M, O) -> complete states (M,).
        observe: the inverse of ``state``, for a task that gives several observations; the task's own without it.
        train: how a loss is trained.
    """

    def estimator(proposal: Belief) -> PosteriorEstimator:
        space = simulator.parameters
        embedding = FilteredEmbedding(
            simulator,
            proposal.box,
            task.observation_size,
            task.action_spec.shape[-1],
            state=state,
            command=task.command,
            observe=observe or task.observe,
        )
        return NeuralEstimator(
            NeuralPosteriorLoss(embedding, MixtureEstimator(space, embedding.size, box=proposal.box)), train
        )

    return estimator
