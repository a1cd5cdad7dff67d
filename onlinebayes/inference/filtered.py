"""The estimator for noisy sensors: trajectories are told by what a Kalman filter through the simulator makes of them.

    x_1 ... x_n -> filters -> likeliest theta and its covariance -> mixture density network -> q(theta | x_1 ... x_n)

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

from onlinebayes.embeddings import FilteredEmbedding, SimulatorFilter
from onlinebayes.embeddings.likeliest import DISTURBED, Levels
from onlinebayes.inference.base import Belief, PosteriorEstimator
from onlinebayes.inference.distributions import Box
from onlinebayes.inference.neural import TRAIN, Fit, mixture_of
from onlinebayes.simulators import Simulator, Task


def filtered_estimator(
    simulator: Simulator,
    task: Task,
    *,
    state: Callable[[Tensor], TensorDict],
    observe: Callable[[TensorDictBase], Any] | None = None,
    train: Fit = TRAIN,
    levels: Levels = DISTURBED,
) -> Callable[[Belief], PosteriorEstimator]:
    """Build the maker of estimators that a trainer needs: proposal -> a fresh estimator in the proposal's box.

    Arguments as for :func:`~onlinebayes.inference.residual_estimator`; ``levels`` as for
    :class:`~onlinebayes.embeddings.FilteredEmbedding`.
    """

    def estimator(proposal: Belief) -> PosteriorEstimator:
        model = filter_of(simulator, task, proposal.box, state=state, observe=observe)
        return mixture_of(FilteredEmbedding(model, task.action_spec.shape[-1], levels), proposal, train)

    return estimator


def filter_of(
    simulator: Simulator,
    task: Task,
    box: Box,
    *,
    state: Callable[[Tensor], TensorDict],
    observe: Callable[[TensorDictBase], Any] | None = None,
) -> SimulatorFilter:
    """The filter of a simulator's task over a box; other arguments as above."""
    return SimulatorFilter(
        simulator, box, task.observation_size, state=state, command=task.command, observe=observe or task.observe
    )
