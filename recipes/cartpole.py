"""CartPole with unknown pole: Online BayesSim infers half the pole's length and its mass while PPO learns to balance.

    python -m recipes.cartpole [--seed S] [--noise 0.01]     one run, about 2 minutes
    make cartpole                                            all seeds -> docs/results/cartpole.json

Prior U[.1, 1]^2 as in Table 5.1 of the thesis (log density there: 4.66). A policy trained on the prior alone balances
CartPole too; what a posterior is worth to a policy shows on Pendulum.
"""

from __future__ import annotations

import sys

import torch
import tyro
from tensordict import TensorDict
from torch import Tensor

from envs.cartpole import CartPole, CartPoleTask
from onlinebayes.objectives import ppo
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.trainers import Schedule
from recipes.studies.online import Settings, main
from recipes.studies.online_problem import Goals, Problem


def state(observation: Tensor) -> TensorDict:
    """The state behind an observation (M, 4): everything is observed."""
    position, velocity = observation.double().unflatten(-1, (2, 2)).unbind(-1)
    return TensorDict({"qpos": position, "qvel": velocity}, batch_size=observation.shape[:1])


PROBLEM = Problem(
    name="cartpole",
    simulator=CartPole(ParameterSpace({"length": Parameter(0.1, 1.0, "m"), "mass": Parameter(0.1, 1.0, "kg")})),
    task=CartPoleTask(horizon=500),
    state=state,
    # Position and angle between their limits; velocities as a balancing policy sees them, within +-3 m/s, +-3 rad/s.
    sensor_range=(2 * CartPoleTask.max_position, 6.0, 2 * CartPoleTask.max_angle, 6.0),
    objective=ppo,
    goals=Goals(log_density=9.0, score=475.0),
    schedule=Schedule(steps=6, policy_batches=14, real_steps=50),
    worlds=64,
    batch_steps=64,
)


if __name__ == "__main__":
    torch.set_num_threads(1)
    sys.exit(main(PROBLEM, tyro.cli(Settings, description=__doc__)))
