"""Mountain car with an engine of unknown force: Online BayesSim infers it while PPO learns to swing out of the valley.

    python -m recipes.mountain_car [--seed S] [--kind oracle]     one run, a few minutes; Ctrl-C and again goes on

Worlds with a strong engine teach what weak ones need: in the default world alone random actions never arrive, and there
is nothing to learn from. The prior is therefore worth more to this policy than the truth is at the beginning.
"""

from __future__ import annotations

import sys
from functools import partial

import torch
from tensordict import TensorDict
from torch import Tensor

from envs.mountain_car import HIGH, LOW, MAX_SPEED, MountainCar, MountainCarTask
from onlinebayes.experiments import Run, Settings, hidden_truth, main
from onlinebayes.inference import BoxUniform, filtered_estimator, fit
from onlinebayes.objectives import PPOSettings, ppo
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.trainers import Problem, Sizes, online_trainer

SPACE = ParameterSpace({"force": Parameter(0.0005, 0.005, "length/step2")})
RANGE = torch.tensor((HIGH - LOW, 2 * MAX_SPEED))


def state(observation: Tensor) -> TensorDict:
    """The state behind an observation (M, 2): everything is observed."""
    position, speed = observation.double().split(1, dim=-1)
    return TensorDict({"qpos": position, "qvel": speed}, batch_size=observation.shape[:1])


def build(settings: Settings) -> Run:
    """The whole composition: system, prior, sensors, objective, estimator, real system, trainer."""
    problem = Problem(MountainCar(SPACE), MountainCarTask(), BoxUniform(SPACE), settings.noise * RANGE)
    truth = hidden_truth(SPACE, settings.seed, {"force": 0.001}, settings.truth)
    learning = PPOSettings(normalise=True, gamma=0.998, lmbda=1.0, frames_per_batch=8192, minibatch=1024)
    objective = ppo(*problem.specs, settings.learning(learning))
    steps, batches, simulations, epochs = (2, 2, 100, 4) if settings.short else (6, 14, 300, 25)
    train = partial(fit, epochs=epochs, batch_size=50, learning_rate=1e-3)
    workers = settings.workers()
    trainer = online_trainer(
        problem,
        objective,
        estimator=filtered_estimator(problem.simulator, problem.task, state=state, train=train),
        real=problem.hidden(truth, settings.seed + 2000),
        schedule=settings.schedule(steps, batches, real_steps=50),
        sizes=Sizes(worlds=64, batch_steps=128, simulations=simulations, groups=64),
        worlds=settings.worlds(problem, truth),
        workers=workers,
        seed=settings.seed,
    )
    return Run(problem, trainer, truth, workers=workers)


if __name__ == "__main__":
    sys.exit(main("mountain_car", build, __doc__))
