"""Table 5.1: the joint density of two parameters, in one round and at the end of online learning.

    one round    figure = log q(true theta | six rollouts of 50 steps), the recipe's policy, untrained
    online       figure = log p_T(true theta), T = 6 outer steps of a recipe, one measured rollout of 50 steps in each

``LSTM in the loop`` is the thesis's own learner: a recipe with an LSTM and a mixture in the place of the filter. The
recipe itself, with the filter, is in ``make table-online``. With 1 % noise the ceiling is the exact posterior of the
six rollouts of the one round.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.embeddings import FilteredEmbedding, LSTMEmbedding, TransitionFeatures
from onlinebayes.experiments import Run, Settings
from onlinebayes.inference import Belief, BoxUniform, PosteriorEstimator, filter_of
from onlinebayes.inference.neural import mixture_of
from onlinebayes.runs import generator, seed_everything
from onlinebayes.trainers import Listed, OnlineState
from recipes.studies.table_online import ROWS, reference
from recipes.studies.thesis.columns import CEILING, COLUMNS, LSTM_TRAIN, Data, beliefs
from recipes.studies.thesis.printed import LOOP

SETS, ROLLOUTS, STEPS = 500, 6, 50
BATCHES = {"CartPole": 4, "Pendulum": 15, "Acrobot, masses": 4, "Acrobot, lengths": 4}
"""Of the policy in an outer step: some 16 000 frames, as the thesis's 300 episodes of 50 steps have."""

PROTOCOL = (
    f"one round: {SETS} thetas of six rollouts of 50 steps, untrained policy, six measured rollouts; online: six outer"
    " steps with 16 000 frames of the policy's and one measured rollout each; thesis: 30 outer steps of 200 rollouts"
)

Estimator = Callable[[Belief], PosteriorEstimator]


def judged(name: str, noise: float, seed: int) -> dict[str, Any]:
    """Column -> log density of the truth, in one round."""
    seed_everything(seed)
    made = ROWS[name].build(Settings(seed=seed, noise=noise))
    problem, policy, draw = made.problem, made.trainer.objective.policy, generator(seed, "thesis")

    def simulate(theta: Tensor, draw: torch.Generator, number: int) -> TensorDict:
        worlds = problem.simulations(len(theta), STEPS, int(torch.randint(2**31, (), generator=draw)))
        return torch.stack([worlds.draw([policy], Listed(theta)) for _ in range(number)], dim=1)

    def filtered() -> FilteredEmbedding:
        model = filter_of(problem.simulator, problem.task, problem.prior.box, state=ROWS[name].recipe.state)
        return FilteredEmbedding(model, problem.task.action_spec.shape[-1])

    prior = BoxUniform(problem.space)
    sets = simulate(prior.sample((SETS,), draw), draw, ROLLOUTS)
    measured = simulate(made.truth[None], draw, ROLLOUTS)[0].exclude("theta")
    data = Data(prior, sets, measured, simulate, filtered)
    found = {column: float(belief.log_prob(made.truth)) for column, belief in beliefs(data, seed, COLUMNS).items()}
    if noise:
        exact = reference(made, ROWS[name].recipe.state)
        exact.fit(sets[:, 0], generator=draw)
        found[CEILING] = float(exact.condition(measured).log_prob(made.truth))
    return found


def in_the_loop(name: str, noise: float, seed: int) -> dict[str, Any]:
    """The same at the end of a recipe whose estimator is the thesis's."""
    seed_everything(seed)
    made = ROWS[name].build(Settings(seed=seed, noise=noise))
    schedule = replace(made.trainer.schedule, policy_batches=BATCHES[name])
    trainer = replace(made.trainer, schedule=schedule, estimator=by_lstm(made))
    state = trainer.run(OnlineState.begin(made.problem.prior))
    return {LOOP: float(state.belief.log_prob(made.truth))}


def by_lstm(made: Run) -> Estimator:
    """An LSTM over raw transitions that learns with a mixture of five."""
    task = made.problem.task
    features = partial(TransitionFeatures, task.observation_size, task.action_spec.shape[-1])
    return lambda proposal: mixture_of(LSTMEmbedding(features()), proposal, LSTM_TRAIN)
