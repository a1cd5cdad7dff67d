"""A Gymnasium environment of your own in the place of a simulator: its parameters are inferred, a policy learns in it.

    python -m recipes.custom_gym [--seed S] [--short]      a few minutes; Ctrl-C and again goes on

Nothing here is batched: sixteen of Gymnasium's own pendulums step one after the other, ``Parameterized`` sets length
and mass of each at reset, and the hidden system is one more of them.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import gymnasium
import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl.envs import GymWrapper

from envs.pendulum import MAX_SPEED, Pendulum, PendulumTask
from onlinebayes import experiments
from onlinebayes.embeddings import SummaryEmbedding, TransitionFeatures
from onlinebayes.experiments import Run, hidden_truth, main
from onlinebayes.inference import (
    Belief,
    BoxUniform,
    MixtureEstimator,
    NeuralEstimator,
    NeuralPosteriorLoss,
    PosteriorEstimator,
    fit,
)
from onlinebayes.objectives import SACSettings, sac
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators import Parameterized, Shape
from onlinebayes.trainers import EnvPlayer, EnvProblem, Sizes, online_trainer

SPACE = ParameterSpace({"length": Parameter(0.5, 1.5, "m"), "mass": Parameter(0.5, 1.5, "kg")})
RANGE = torch.tensor((2.0, 2.0, 2 * MAX_SPEED))  # of cos, sin and rate, to which sensor noise is relative


@dataclass(frozen=True)
class Settings(experiments.Settings):
    """One run."""

    noise: float = 0.0
    """standard deviation of the sensor noise, as a share of each observed value's range"""


def set_parameters(env: Any, values: Mapping[str, float]) -> None:
    """Set the parameters by Gymnasium's names for them."""
    env.unwrapped.l, env.unwrapped.m = values["length"], values["mass"]


def pendulum() -> Parameterized:
    """One of Gymnasium's pendulums, with parameters."""
    return Parameterized(GymWrapper(gymnasium.make("Pendulum-v1")), SPACE, set_parameters)


def look(env: Any) -> tuple[tuple[Shape, ...], Tensor]:
    """Gymnasium's pendulum as it hangs, drawn as ours is."""
    drawn, theta = Pendulum(SPACE), torch.tensor([env.unwrapped.l, env.unwrapped.m], dtype=torch.float64)
    angle = torch.tensor([[env.unwrapped.state[0]]], dtype=torch.float64)
    return drawn.shapes(theta), drawn.poses(theta, TensorDict({"qpos": angle}, batch_size=(1,)))[0]


def estimator(epochs: int, proposal: Belief) -> PosteriorEstimator:
    """Differences of observations and their products with the torque -> averages -> a mixture: no simulator needed."""
    embedding = SummaryEmbedding(TransitionFeatures(3, 1))
    network = MixtureEstimator(SPACE, embedding.size, box=proposal.box)
    return NeuralEstimator(NeuralPosteriorLoss(embedding, network), partial(fit, epochs=epochs))


def build(settings: Settings) -> Run[EnvProblem]:
    """The whole composition: environment, prior, sensors, objective, estimator, real system, trainer."""
    noise = settings.noise * RANGE
    problem = EnvProblem(pendulum, BoxUniform(SPACE), 200, noise, name="Pendulum-v1", channels=PendulumTask.channels)
    truth = hidden_truth(SPACE, settings.seed, {"length": 1.0, "mass": 0.8}, settings.truth)
    learning = SACSettings(tau=0.02, gamma=0.98, reward_scale=0.1, alpha=0.3, frames_per_update=4)
    objective = sac(*problem.specs, settings.learning(learning))
    steps, batches, simulations = (2, 2, 320) if settings.short else (4, 40, 480)
    workers = settings.workers()
    trainer = online_trainer(
        problem,
        objective,
        estimator=partial(estimator, 30),
        real=problem.hidden(truth, settings.seed + 2000),
        schedule=settings.schedule(steps, batches, real_steps=50),
        sizes=Sizes(worlds=16, batch_steps=16, simulations=simulations, groups=16),
        worlds=settings.worlds(problem, truth),
        workers=workers,
        seed=settings.seed,
    )
    return Run(problem, trainer, truth, EnvPlayer(problem, objective.policy, truth, look, dt=0.05), workers=workers)


if __name__ == "__main__":
    sys.exit(main("custom_gym", build, __doc__, Settings))
