"""Pendulum of unknown length and mass: Online BayesSim infers both while SAC learns to swing up and hold.

    python -m recipes.pendulum [--seed S] [--kind oracle]     one run, a minute or two; Ctrl-C and again goes on

Prior U[.1, 1]^2 as in Table 5.1 of the thesis (log density there: 4.076). Here a posterior pays: what swings up a light
pendulum leaves a heavy one hanging, and a policy trained on the prior alone has to find one way for all.
"""

from __future__ import annotations

import sys
from functools import partial

import torch
from tensordict import TensorDict
from torch import Tensor

from envs.pendulum import MAX_SPEED, Pendulum, PendulumTask
from onlinebayes.experiments import Run, Settings, hidden_truth, main
from onlinebayes.inference import BoxUniform, filtered_estimator, fit
from onlinebayes.objectives import SACSettings, sac
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.trainers import Problem, Sizes, online_trainer

SPACE = ParameterSpace({"length": Parameter(0.1, 1.0, "m"), "mass": Parameter(0.1, 1.0, "kg")})
RANGE = torch.tensor((2.0, 2.0, 2 * MAX_SPEED))  # of cos, sin and rate, to which sensor noise is relative


# A tenth of the reward: with the whole of it the critics are still growing into their scale, and exploration has died
# down, when the worlds have narrowed. The buffer is some 20 batches: old worlds fade within an outer step.
LEARNING = SACSettings(tau=0.02, gamma=0.98, reward_scale=0.1, alpha=0.3, frames_per_update=8, memory=20_000)


def state(observation: Tensor) -> TensorDict:
    """The state behind an observation (M, 3): the angle of its cosine and sine."""
    cos, sin, rate = observation.double().split(1, dim=-1)
    return TensorDict({"qpos": torch.atan2(sin, cos), "qvel": rate}, batch_size=observation.shape[:1])


def build(settings: Settings) -> Run:
    """The whole composition: system, prior, sensors, objective, estimator, real system, trainer."""
    problem = Problem(Pendulum(SPACE), PendulumTask(), BoxUniform(SPACE), settings.noise * RANGE)
    truth = hidden_truth(SPACE, settings.seed, {"length": 1.0, "mass": 1.0}, settings.truth)
    objective = sac(*problem.specs, settings.learning(LEARNING))
    steps, batches, simulations, epochs = (2, 3, 100, 4) if settings.short else (6, 20, 300, 25)
    train = partial(fit, epochs=epochs, batch_size=50, learning_rate=1e-3)
    workers = settings.workers()
    trainer = online_trainer(
        problem,
        objective,
        estimator=filtered_estimator(problem.simulator, problem.task, state=state, train=train),
        real=problem.hidden(truth, settings.seed + 2000),
        schedule=settings.schedule(steps, batches, real_steps=50),
        sizes=Sizes(worlds=64, batch_steps=16, simulations=simulations, groups=64),
        worlds=settings.worlds(problem, truth),
        workers=workers,
        seed=settings.seed,
    )
    return Run(problem, trainer, truth, workers=workers)


if __name__ == "__main__":
    sys.exit(main("pendulum", build, __doc__))
