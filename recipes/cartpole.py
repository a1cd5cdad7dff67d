"""CartPole with unknown pole: Online BayesSim infers half the pole's length and its mass while PPO learns to balance.

    python -m recipes.cartpole [--seed S] [--kind oracle]     one run, a minute or two; Ctrl-C and again goes on

Prior U[.1, 1]^2 as in Table 5.1 of the thesis (log density there: 4.66). A policy trained on the prior alone balances
this CartPole too. With an unknown motor in place of the pole's mass it takes longer: what catches the pole with a weak
motor throws it over with a strong one. ``make online`` has both.
"""

from __future__ import annotations

import sys
from functools import partial

import torch
from tensordict import TensorDict
from torch import Tensor

from envs.cartpole import CartPole, CartPoleTask
from onlinebayes.experiments import Run, Settings, hidden_truth, main
from onlinebayes.inference import BoxUniform, filtered_estimator, fit
from onlinebayes.objectives import PPOSettings, ppo
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.trainers import Problem, Sizes, online_trainer

SPACE = ParameterSpace({"length": Parameter(0.1, 1.0, "m"), "mass": Parameter(0.1, 1.0, "kg")})
MOTOR = ParameterSpace({"force": Parameter(1.0, 40.0, "N"), "length": Parameter(0.1, 2.0, "m")})
DEFAULT = {"length": 0.5, "mass": 0.1, "force": 10.0}  # Gymnasium's
# Position and angle between their limits; velocities as a balancing policy sees them, within +-3 m/s, +-3 rad/s.
RANGE = torch.tensor((2 * CartPoleTask.max_position, 6.0, 2 * CartPoleTask.max_angle, 6.0))

PPO = PPOSettings(epochs=10, minibatch=1024, learning_rate=3e-3, lmbda=0.98, entropy=0.0)
"""Half the gradient steps of the default minibatch; to fall is noise enough, so that nothing is paid for more."""


def state(observation: Tensor) -> TensorDict:
    """The state behind an observation (M, 4): everything is observed."""
    position, velocity = observation.double().unflatten(-1, (2, 2)).unbind(-1)
    return TensorDict({"qpos": position, "qvel": velocity}, batch_size=observation.shape[:1])


def build(settings: Settings, space: ParameterSpace = SPACE) -> Run:
    """The whole composition: system, prior, sensors, objective, estimator, real system, trainer."""
    problem = Problem(CartPole(space), CartPoleTask(), BoxUniform(space), settings.noise * RANGE)
    truth = hidden_truth(space, settings.seed, {name: DEFAULT[name] for name in space.names}, settings.truth)
    objective = ppo(*problem.specs, settings.learning(PPO))
    steps, batches, simulations, epochs = (2, 2, 150, 10) if settings.short else (8, 10, 300, 25)
    train = partial(fit, epochs=epochs, batch_size=50, learning_rate=1e-3)
    workers = settings.workers()
    trainer = online_trainer(
        problem,
        objective,
        estimator=filtered_estimator(problem.simulator, problem.task, state=state, train=train),
        real=problem.hidden(truth, settings.seed + 2000),
        schedule=settings.schedule(steps, batches, real_steps=50),
        sizes=Sizes(worlds=64, batch_steps=64, simulations=simulations, groups=64),
        worlds=settings.worlds(problem, truth),
        workers=workers,
        seed=settings.seed,
    )
    return Run(problem, trainer, truth, workers=workers)


if __name__ == "__main__":
    sys.exit(main("cartpole", build, __doc__))
