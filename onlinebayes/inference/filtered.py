"""The estimator for noisy sensors: each trajectory told by what a Kalman filter through the simulator makes of it.

    x -> filter over (state, theta) -> mean and covariance of theta -> mixture density network -> q(theta | x)

    estimator = filtered_estimator(simulator, task, state=...)      # proposal -> a fresh estimator in its box

It asks for the same as :func:`~onlinebayes.inference.residual_estimator`, whose residuals are taken one step ahead from
a noisy observation; this one is sharper under noise (see :class:`~onlinebayes.embeddings.FilteredEmbedding`), and has
no use for actions and observations that the simulator does not explain.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.embeddings import FilteredEmbedding
from onlinebayes.inference.base import Belief, PosteriorEstimator
from onlinebayes.inference.neural import TRAIN, Fit, mixture_of
from onlinebayes.simulators import Simulator, Task


def filtered_estimator(
    simulator: Simulator,
    task: Task,
    *,
    state: Callable[[Tensor], TensorDict],
    observe: Callable[[TensorDictBase], Any] | None = None,
    train: Fit = TRAIN,
) -> Callable[[Belief], PosteriorEstimator]:
    """What a trainer asks for: proposal -> a fresh estimator in the proposal's box.

    Arguments as for :func:`~onlinebayes.inference.residual_estimator`.
    """

    def estimator(proposal: Belief) -> PosteriorEstimator:
        embedding = FilteredEmbedding(
            simulator,
            proposal.box,
            task.observation_size,
            task.action_spec.shape[-1],
            state=state,
            command=task.command,
            observe=observe or task.observe,
        )
        return mixture_of(embedding, proposal, train)

    return estimator
