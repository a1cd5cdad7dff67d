"""A hopper on ground of unknown friction, learnt in MuJoCo, judged in another physics engine: Online BayesSim with PPO.

    python -m recipes.hopper [--real mujoco] [--kind prior] [--low .1]     half an hour; Ctrl-C and again goes on

The policy learns in MuJoCo's worlds of the belief; the real system is Drake's hopper by default (the extra
``robotics``), which measures the trajectories and judges the policy. Prior of the friction U[.3, .5], or U[.1, .5] with
``--low .1``, as in the thesis.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import partial
from typing import Literal

import torch

from envs.hopper import FRICTION, DrakeHopper, standard_hopper, standard_task
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
from onlinebayes.objectives import PPOSettings, ppo
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Simulator
from onlinebayes.trainers import Problem, SimulatedPlayer, Sizes, online_trainer

RANGE = torch.tensor((*[1.0] * 5, *[10.0] * 6))  # positions [m, rad], velocities: 1 % is a centimetre
HIGH, TRUTH = 0.5, 0.35
RUN_UP = 150  # steps of a real trajectory: friction is told by a hopper that runs
EPISODES = 16  # to judge by: Drake steps a thousand times a second
Engine = Literal["drake", "mujoco"]


@dataclass(frozen=True)
class Settings(experiments.Settings):
    """One run."""

    real: Engine = "drake"
    """the engine that plays the real system"""
    low: float = 0.3
    """least friction of the prior"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.05 <= self.low <= TRUTH:
            raise BadInput(f"low {self.low}", f"needs .05 <= low <= {TRUTH}, the friction that is hidden with seed 0")


def space_of(low: float) -> ParameterSpace:
    """The unknown friction, of floor and bodies."""
    return ParameterSpace({FRICTION: Parameter(low, HIGH)})


def engine_of(real: Engine, space: ParameterSpace) -> Simulator:
    """The real system: Drake's hopper, or MuJoCo's with the integrator of its file."""
    return DrakeHopper(space) if real == "drake" else standard_hopper(space, threads=1, firm=True)


def estimator(epochs: int, proposal: Belief) -> PosteriorEstimator:
    """Transitions without a simulator beside them: through contacts a residual of one step tells no more."""
    embedding = SummaryEmbedding(TransitionFeatures(11, 3))
    network = MixtureEstimator(proposal.space, embedding.size, box=proposal.box)
    train = partial(fit, epochs=epochs, batch_size=50, learning_rate=4e-3)
    return NeuralEstimator(NeuralPosteriorLoss(embedding, network), train)


def learning(worlds: int, steps: int) -> PPOSettings:
    """PPO on batches of ``worlds`` x ``steps`` frames, its learning rate as high as the divergence allows."""
    return PPOSettings(
        normalise=True,
        frames_per_batch=worlds * steps,
        minibatch=2048,
        epochs=8,
        entropy=0.0005,
        learning_rate=1.5e-3,
        gamma=0.995,
        lmbda=0.97,
        target_kl=0.03,
    )


def build(settings: Settings) -> Run:
    """The whole composition: system, prior, sensors, objective, estimator, real system, trainer."""
    space = space_of(settings.low)
    prior, sd = BoxUniform(space), settings.noise * RANGE
    problem = Problem(standard_hopper(space, threads=1, quick=True, firm=True), standard_task(), prior, sd)
    machine = Problem(engine_of(settings.real, space), standard_task(), prior, sd)
    truth = hidden_truth(space, settings.seed, {FRICTION: TRUTH}, settings.truth)
    sizes = Sizes(worlds=256, batch_steps=32, simulations=200 if settings.short else 1000, groups=48)
    objective = ppo(*problem.specs, settings.learning(learning(sizes.worlds, sizes.batch_steps)))
    steps, batches, epochs = (2, 2, 8) if settings.short else (8, 75, 25)
    trainer = online_trainer(
        problem,
        objective,
        estimator=partial(estimator, epochs),
        real=machine.hidden(truth, settings.seed + 2000),
        schedule=settings.schedule(steps, batches, real_steps=RUN_UP),
        sizes=sizes,
        worlds=settings.worlds(problem, truth),
        seed=settings.seed,
    )
    player = SimulatedPlayer(problem, objective.policy, truth, machine)
    return Run(
        problem, trainer, truth, player, score=partial(machine.score, episodes=2 if settings.short else EPISODES)
    )


if __name__ == "__main__":
    sys.exit(main("hopper", build, __doc__, Settings))
