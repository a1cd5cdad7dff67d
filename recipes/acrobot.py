"""Acrobot with unknown links: Online BayesSim infers both masses while PPO learns to swing up.

    python -m recipes.acrobot [--seed S] [--kind oracle]     one run, a few minutes; Ctrl-C and again goes on

Prior U[.5, 2]^2 as in Table 5.1 of the thesis (log density there: 2.85). Of :data:`LENGTHS`, its other row (2.25), only
the first is in the dynamics. ``make table-online`` has both.
"""

from __future__ import annotations

import sys
from functools import partial

import torch
from tensordict import TensorDict
from torch import Tensor

from envs.acrobot import MAX_SPEEDS, Acrobot, AcrobotTask
from onlinebayes.experiments import Run, Settings, hidden_truth, main
from onlinebayes.inference import BoxUniform, filtered_estimator, fit
from onlinebayes.objectives import PPOSettings, ppo
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.trainers import Problem, Sizes, online_trainer

SPACE = ParameterSpace({"mass1": Parameter(0.5, 2.0, "kg"), "mass2": Parameter(0.5, 2.0, "kg")})
LENGTHS = ParameterSpace({"length1": Parameter(0.1, 1.5, "m"), "length2": Parameter(0.1, 1.5, "m")})
DEFAULT = 1.0  # of each, Gymnasium's [kg, m]
RANGE = torch.tensor((2.0, 2.0, 2.0, 2.0, MAX_SPEEDS[0], MAX_SPEEDS[1]))  # half of the rates' limits, as rates go


def state(observation: Tensor) -> TensorDict:
    """The state behind an observation (M, 6): the angles of their cosines and sines."""
    cos1, sin1, cos2, sin2, *rates = observation.double().unbind(-1)
    angles = torch.stack((torch.atan2(sin1, cos1), torch.atan2(sin2, cos2)), dim=-1)
    return TensorDict({"qpos": angles, "qvel": torch.stack(rates, dim=-1)}, batch_size=observation.shape[:1])


def build(settings: Settings, space: ParameterSpace = SPACE) -> Run:
    """The whole composition: system, prior, sensors, objective, estimator, real system, trainer."""
    problem = Problem(Acrobot(space), AcrobotTask(), BoxUniform(space), settings.noise * RANGE)
    truth = hidden_truth(space, settings.seed, dict.fromkeys(space.names, DEFAULT), settings.truth)
    objective = ppo(*problem.specs, settings.learning(PPOSettings(epochs=10)))
    steps, batches, simulations, epochs = (2, 2, 150, 10) if settings.short else (6, 14, 300, 25)
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
    sys.exit(main("acrobot", build, __doc__))
