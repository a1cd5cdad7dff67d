"""A skid-steered robot on a circle: MPPI plans for every robot that the belief holds possible, and the belief learns.

    python -m recipes.skid_steer [--seed S] [--kind oracle]      one run, a minute; Ctrl-C and again goes on

Section 5.4.3 of the thesis, in simulation. The robot drives for 20 s by plans for the prior. Its trajectory gives the
first posterior, and it drives again by plans for that. Wheel radius and axial distance can be measured by hand; where
the centre of rotation lies, x_icr, can hardly be. The truth of seed 0 has x_icr = +.2 m, which is the hard side: the
tracked point swings out before it turns, and a planner that looks ahead by less than 5 s stands still.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import partial

import torch
from tensordict import TensorDict
from torch import Tensor

from envs.skid_steer import CircleTask, SkidSteerKinematics
from onlinebayes.control import MPPI, Bounds, Knots, TaskCost
from onlinebayes.experiments import Run, Settings, hidden_truth, main
from onlinebayes.inference import Belief, BoxUniform, Windowed, filtered_estimator, fit
from onlinebayes.objectives import Planned
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.trainers import Problem, Sizes, online_trainer

SPACE = ParameterSpace(
    {
        "radius": Parameter(0.02, 0.2, "m"),
        "axial_distance": Parameter(0.2, 1.0, "m"),
        "x_icr": Parameter(-0.5, 0.5, "m"),
    }
)
"""The prior's box; the thesis names none."""

SENSORS = torch.tensor((0.003, 0.003, 0.003))
"""Standard deviation of x, y [m] and yaw [rad]."""


def state(observation: Tensor) -> TensorDict:
    """The state behind a pose (M, 3)."""
    return TensorDict({"qpos": observation.double()}, batch_size=observation.shape[:1])


def planner(task: CircleTask, seed: int) -> MPPI:
    """Five seconds ahead, 128 candidates in six worlds."""
    simulator = SkidSteerKinematics(SPACE, dtype=torch.float32)
    return MPPI(
        simulator,
        TaskCost(task),
        state=state,
        bounds=Bounds.of(task.action_spec),
        noise=Knots(1.0, 5),
        horizon=50,
        samples=128,
        thetas=6,
        temperature=0.1,
        seed=seed,
    )


def estimator(task: CircleTask, epochs: int, proposal: Belief) -> Windowed:
    """A filter through the kinematics, over windows of a second."""
    train = partial(fit, epochs=epochs, batch_size=50, learning_rate=2e-3)
    return Windowed(filtered_estimator(SkidSteerKinematics(SPACE), task, state=state, train=train)(proposal), steps=10)


def composed(settings: Settings, truth: Tensor, steps: int) -> Run:
    """System, prior, sensors, planner, estimator, real system, trainer."""
    simulations, epochs, horizon = (60, 8, 60) if settings.short else (500, 40, 200)
    task = CircleTask(horizon=horizon)
    plans = planner(task, settings.seed)
    problem = Problem(SkidSteerKinematics(SPACE), task, BoxUniform(SPACE), SENSORS, plans.transforms)
    trainer = online_trainer(
        problem,
        Planned(plans),
        estimator=partial(estimator, task, epochs),
        real=problem.hidden(truth, settings.seed + 2000),
        schedule=settings.schedule(steps, 0, real_steps=horizon),
        sizes=Sizes(simulations=simulations, groups=64),
        worlds=settings.worlds(problem, truth),
        repeats=True,
        seed=settings.seed,
    )
    return Run(problem, trainer, truth, score=partial(problem.score, episodes=4))


def build(settings: Settings) -> Run:
    """The run, which has to beat the plans for the prior."""
    truth = hidden_truth(
        SPACE, settings.seed, {"radius": 0.0625, "axial_distance": 0.475, "x_icr": 0.2}, settings.truth
    )
    made = composed(settings, truth, steps=2 if settings.short else 3)
    if settings.kind == "prior":
        return made
    objective = made.trainer.objective
    assert isinstance(objective, Planned)
    objective.set_belief(made.problem.prior)
    return replace(made, to_beat=made.problem.score(objective.policy, truth, episodes=4))


if __name__ == "__main__":
    sys.exit(main("skid_steer", build, __doc__))
