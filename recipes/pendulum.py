"""Pendulum of unknown length and mass: Online BayesSim infers both while SAC learns to swing up and hold.

    python -m recipes.pendulum [--seed S] [--noise 0.01]     one run, about 2 minutes
    make pendulum                                            all seeds -> docs/results/pendulum.json

Prior U[.1, 1]^2 as in Table 5.1 of the thesis (log density there: 4.076). Here a posterior pays: what swings up a light
pendulum leaves a heavy one hanging, and a policy trained on the prior alone has to find one way for all.
"""

from __future__ import annotations

import sys
from functools import partial

import torch
import tyro
from tensordict import TensorDict
from torch import Tensor

from envs.pendulum import MAX_SPEED, Pendulum, PendulumTask
from onlinebayes.objectives import sac
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.trainers import Schedule
from recipes.studies.online import Settings, main
from recipes.studies.online_problem import Goals, Problem


def state(observation: Tensor) -> TensorDict:
    """The state behind an observation (M, 3): the angle of its cosine and sine."""
    cos, sin, rate = observation.double().split(1, dim=-1)
    return TensorDict({"qpos": torch.atan2(sin, cos), "qvel": rate}, batch_size=observation.shape[:1])


PROBLEM = Problem(
    name="pendulum",
    simulator=Pendulum(ParameterSpace({"length": Parameter(0.1, 1.0, "m"), "mass": Parameter(0.1, 1.0, "kg")})),
    task=PendulumTask(horizon=200),
    state=state,
    sensor_range=(2.0, 2.0, 2 * MAX_SPEED),
    # A tenth of the reward: with the whole of it the Q networks are still growing into their scale, and exploration has
    # died down, when the worlds have narrowed. The memory is some 20 batches: old worlds fade within an outer step.
    objective=partial(sac, tau=0.02, gamma=0.98, reward_scale=0.1, alpha=0.3, frames_per_update=16, memory=20_000),
    goals=Goals(log_density=7.0, regret=25.0, default_score=-200.0),
    schedule=Schedule(steps=6, policy_batches=20, real_steps=50),
    worlds=64,
    batch_steps=16,
)


if __name__ == "__main__":
    torch.set_num_threads(1)
    sys.exit(main(PROBLEM, tyro.cli(Settings, description=__doc__)))
