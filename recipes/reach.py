"""An arm reaches for goals: DDPG with hindsight learns from rewards that hardly ever come, while the arm is identified.

    python -m recipes.reach [--seed S] [--kind oracle]     one run, a few minutes; Ctrl-C and again goes on

What the arm reached is told again as if it had been the goal (Andrychowicz et al. 2017). Unknown are the damping and
the motor of the elbow.
"""

from __future__ import annotations

import sys
from functools import partial

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from envs.reach import PHYSICAL, ReachTask, arm, fingertip
from onlinebayes.experiments import Run, Settings, hidden_truth, main
from onlinebayes.inference import BoxUniform, fit, residual_estimator
from onlinebayes.objectives import DDPGSettings, Hindsight, ddpg
from onlinebayes.trainers import Problem, Sizes, online_trainer

SPACE = PHYSICAL.subspace(["joint.elbow.damping", "actuator.elbow.gear"])
# Of cosines and sines, rates [rad/s] and fingertip [m], to which sensor noise is relative; goals are known exactly.
RANGE = torch.tensor((*[2.0] * 6, *[6.0] * 3, *[1.2] * 3))

LEARNING = DDPGSettings(widths=(64, 64, 64), gamma=0.9, value_range=(-10.0, 0.0), action_penalty=0.1)


def state(observation: Tensor) -> TensorDict:
    """The state behind an observation (M, 12): the angles of their cosines and sines."""
    cos, sin, rates, _ = observation.double().split(3, dim=-1)
    return TensorDict({"qpos": torch.atan2(sin, cos), "qvel": rates}, batch_size=observation.shape[:1])


def observe(state: TensorDictBase) -> Tensor:
    """The observation without the goals."""
    q = state["qpos"]
    return torch.cat((q.cos(), q.sin(), state["qvel"], fingertip(q)), dim=-1).to(torch.float32)


def build(settings: Settings) -> Run:
    """The whole composition: system, prior, sensors, objective, estimator, real system, trainer."""
    task = ReachTask()
    problem = Problem(arm(SPACE, threads=1), task, BoxUniform(SPACE), settings.noise * RANGE)
    default = dict(zip(SPACE.names, problem.simulator.nominal.tolist(), strict=True))
    truth = hidden_truth(SPACE, settings.seed, default, settings.truth)
    objective = ddpg(
        *problem.specs,
        settings.learning(LEARNING),
        in_keys=["observation", "desired_goal"],
        hindsight=Hindsight(task.goal_reward),
    )
    steps, batches, simulations, epochs = (2, 2, 300, 30) if settings.short else (4, 8, 300, 20)
    train = partial(fit, epochs=epochs, batch_size=50, learning_rate=4e-3)
    workers = settings.workers()
    trainer = online_trainer(
        problem,
        objective,
        estimator=residual_estimator(problem.simulator, problem.task, state=state, observe=observe, train=train),
        real=problem.hidden(truth, settings.seed + 2000),
        schedule=settings.schedule(steps, batches, real_steps=50),
        sizes=Sizes(worlds=32, batch_steps=50, simulations=simulations, groups=48),
        worlds=settings.worlds(problem, truth),
        workers=workers,
        seed=settings.seed,
    )
    return Run(problem, trainer, truth, workers=workers)


if __name__ == "__main__":
    sys.exit(main("reach", build, __doc__))
