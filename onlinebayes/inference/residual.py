"""The estimator for systems whose state can be read off an observation: transitions told beside a simulator's own.

    r = o' - g(o, a; theta_0),  J = dg/dtheta        g: one step of the simulator, theta_0: the proposal's centre
    x -> averages of (r, J W r, J W J) and of the transitions' features -> mixture density network -> q(theta | x)

    estimator = residual_estimator(simulator, task, state=...)      # proposal -> a fresh estimator in its box

Every part can be put together by hand; ``recipes/custom_gym.py`` has an estimator without a simulator.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.embeddings import SimulatorReference, SummaryEmbedding, TransitionFeatures
from onlinebayes.inference.base import Belief, PosteriorEstimator
from onlinebayes.inference.neural import TRAIN, Fit, mixture_of
from onlinebayes.simulators import Simulator, Task


def residual_estimator(
    simulator: Simulator,
    task: Task,
    *,
    state: Callable[[Tensor], TensorDict],
    observe: Callable[[TensorDictBase], Any] | None = None,
    train: Fit = TRAIN,
) -> Callable[[Belief], PosteriorEstimator]:
    """Build the maker of estimators that a trainer needs: proposal -> a fresh estimator in the proposal's box.

    Args:
        simulator: whose parameters are inferred; where it lies, the estimator is trained.
        task: what is commanded and observed.
        state: observations (M, O) -> complete states (M,).
        observe: the inverse of ``state``, for a task that gives several observations; the task's own without it.
        train: how a loss is trained.
    """

    def estimator(proposal: Belief) -> PosteriorEstimator:
        space = simulator.parameters
        reference = SimulatorReference(
            simulator, proposal.box.cross(), state=state, command=task.command, observe=observe or task.observe
        )
        features = TransitionFeatures(
            task.observation_size, task.action_spec.shape[-1], reference=reference, sensitivities=len(space)
        )
        return mixture_of(SummaryEmbedding(features).to(simulator.device), proposal, train)

    return estimator
