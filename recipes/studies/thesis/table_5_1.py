"""Table 5.1: what is believed at the end of online learning, and what others make of the same rollouts.

    figure = log p_T(true theta)       T = 6 outer steps of a recipe, one measured rollout of 50 steps in each

The policy learns from as many frames in each as the thesis's, fewer than the recipes'.

The filter's figure is the recipe's own belief. The other columns learn in one round from ``SETS`` thetas under the six
policies of the run, one rollout each, and are conditioned on its six measured rollouts; so is the ceiling, the exact
posterior, where there is noise. ``LSTM in the loop`` is the thesis's own learner: the recipe with an LSTM and a mixture
in the place of the filter; it measures with policies of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.embeddings import LSTMEmbedding, TransitionFeatures
from onlinebayes.inference import Belief, BoxUniform, PosteriorEstimator
from onlinebayes.inference.neural import mixture_of
from onlinebayes.runs import generator, seed_everything
from onlinebayes.trainers import Listed, OnlineState, Policy
from recipes.common import Run, Settings
from recipes.studies.table_online import ROWS, reference
from recipes.studies.thesis.columns import CEILING, COLUMNS, FILTER, LSTM_TRAIN, Data, beliefs
from recipes.studies.thesis.printed import LOOP

SETS, STEPS = 500, 50
BATCHES = {"CartPole": 4, "Pendulum": 15, "Acrobot, masses": 4, "Acrobot, lengths": 4}
"""Of the policy in an outer step: some 16 000 frames, as the thesis's 300 episodes of 50 steps have."""

Estimator = Callable[[Belief], PosteriorEstimator]
PROTOCOL = (
    "six outer steps of a recipe, each with 16 000 frames of the policy's and one measured rollout of 50 steps;"
    f" other columns: {SETS} thetas of six rollouts; thesis: 30 outer steps of 200 rollouts of 50 steps"
)


def judged(name: str, noise: float, seed: int) -> dict[str, Any]:
    """Column -> log density of the truth."""
    made, state = run(name, noise, seed)
    assert state.real is not None
    problem, n = made.problem, len(state.real)
    members = [state.policies[i] for i in state.made_by]

    def simulate(theta: Tensor, draw: torch.Generator, number: int) -> TensorDict:
        def under(some: Sequence[Policy], theta: Tensor) -> TensorDict:
            worlds = problem.simulations(len(theta), STEPS, int(torch.randint(2**31, (), generator=draw)))
            return torch.stack([worlds.draw([policy], Listed(theta)) for policy in some], dim=1)

        if number == n:
            return under(members, theta)
        return torch.cat([under([policy], part) for policy, part in zip(members, theta.chunk(n), strict=True)])

    draw = generator(seed, "thesis")
    sets = simulate(problem.prior.sample((SETS,), draw), draw, n)
    data = Data(BoxUniform(problem.space), sets, state.real, simulate, None)
    found = {column: float(belief.log_prob(made.truth)) for column, belief in beliefs(data, seed, COLUMNS).items()}
    found[FILTER] = float(state.belief.log_prob(made.truth))
    if noise:
        exact = reference(made, ROWS[name].recipe.state)
        exact.fit(sets[:, 0], generator=draw)
        found[CEILING] = float(exact.condition(state.real).log_prob(made.truth))
    return found


def run(
    name: str, noise: float, seed: int, learner: Callable[[Run], Estimator] | None = None
) -> tuple[Run, OnlineState]:
    """One run of a recipe, with its own estimator or another one."""
    seed_everything(seed)
    made = ROWS[name].build(Settings(seed=seed, noise=noise))
    trainer = replace(made.trainer, schedule=replace(made.trainer.schedule, policy_batches=BATCHES[name]))
    if learner is not None:
        trainer = replace(trainer, estimator=learner(made))
    return made, trainer.run(OnlineState.begin(made.problem.prior))


def in_the_loop(name: str, noise: float, seed: int) -> dict[str, Any]:
    """The thesis's learner in our loop."""
    made, state = run(name, noise, seed, by_lstm)
    return {LOOP: float(state.belief.log_prob(made.truth))}


def by_lstm(made: Run) -> Estimator:
    """An LSTM over raw transitions that learns with a mixture of five."""
    task = made.problem.task
    features = partial(TransitionFeatures, task.observation_size, task.action_spec.shape[-1])
    return lambda proposal: mixture_of(LSTMEmbedding(features()), proposal, LSTM_TRAIN)
