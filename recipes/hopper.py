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
from tensordict import TensorDict
from torch import Tensor, nn

from envs.hopper import FRICTION, DrakeHopper, standard_hopper, standard_task
from onlinebayes.inference import BoxUniform, fit, residual_estimator
from onlinebayes.objectives import PPO, ppo
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators import Simulator
from onlinebayes.trainers import Problem, Schedule, SimulatedPlayer, Sizes, online_trainer
from recipes import common
from recipes.common import Run, hidden_truth, main

RANGE = torch.tensor((*[1.0] * 5, *[10.0] * 6))  # positions [m, rad], velocities: 1 % is a centimetre
HIGH, TRUTH = 0.5, 0.35
EPISODES = 16  # to judge by: Drake steps a thousand times a second
Engine = Literal["drake", "mujoco"]


@dataclass(frozen=True)
class Settings(common.Settings):
    """One run."""

    real: Engine = "drake"
    """the engine that plays the real system"""
    low: float = 0.3
    """least friction of the prior"""


def space_of(low: float) -> ParameterSpace:
    """The unknown friction, of foot and floor."""
    return ParameterSpace({FRICTION: Parameter(low, HIGH)})


def engine_of(real: Engine, space: ParameterSpace) -> Simulator:
    """The real system: Drake's hopper, or MuJoCo's with the integrator of its file."""
    return DrakeHopper(space) if real == "drake" else standard_hopper(space, threads=1)


def state(observation: Tensor) -> TensorDict:
    """The state behind an observation (M, 11); where along the floor it is does not matter."""
    position, velocity = observation.double().split((5, 6), dim=-1)
    qpos = nn.functional.pad(position, (1, 0))
    return TensorDict({"qpos": qpos, "qvel": velocity}, batch_size=observation.shape[:1])


def learning(problem: Problem, worlds: int, steps: int) -> PPO:
    """PPO on batches of ``worlds`` x ``steps`` frames."""
    return ppo(
        *problem.specs,
        normalise=True,
        frames_per_batch=worlds * steps,
        minibatch=2048,
        epochs=8,
        entropy=0.0005,
        learning_rate=1.5e-3,
    )


def build(settings: Settings) -> Run:
    """The whole composition: system, prior, sensors, objective, estimator, real system, trainer."""
    space, task = space_of(settings.low), standard_task()
    prior, sd = BoxUniform(space), settings.noise * RANGE
    problem = Problem(standard_hopper(space, threads=1, quick=True), task, prior, sd)
    machine = Problem(engine_of(settings.real, space), task, prior, sd)
    truth = hidden_truth(space, settings.seed, {FRICTION: TRUTH})
    sizes = Sizes(worlds=256, batch_steps=32, simulations=40 if settings.short else 300, groups=16)
    objective = learning(problem, sizes.worlds, sizes.batch_steps)
    steps, batches, first = (2, 2, 2) if settings.short else (4, 100, 200)
    train = partial(fit, epochs=4 if settings.short else 25, batch_size=50, learning_rate=1e-3)
    order = settings.schedule(steps, batches, real_steps=50).order
    trainer = online_trainer(
        problem,
        objective,
        estimator=residual_estimator(problem.simulator, task, state=state, train=train),
        real=machine.hidden(truth, settings.seed + 2000),
        schedule=Schedule(steps, batches, 50, order, behaviours=2, first_batches=first),
        sizes=sizes,
        worlds=settings.worlds(problem, truth),
        seed=settings.seed,
    )
    player = SimulatedPlayer(problem, objective.policy, truth, machine)
    return Run(problem, trainer, truth, player, score=partial(machine.score, episodes=EPISODES))


if __name__ == "__main__":
    sys.exit(main("hopper", build, __doc__, Settings))
