"""A filter through a simulator whose effects remember: a late command acts in the filter as late as in the data."""

from __future__ import annotations

import torch

from envs.pendulum import Pendulum, PendulumTask
from onlinebayes.embeddings.kalman import Rows
from onlinebayes.inference import Box, BoxUniform, filter_of
from onlinebayes.objectives import sac
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import seed_everything
from onlinebayes.simulators.effects import ActuatorDelay
from onlinebayes.trainers import Point, Problem, trajectories
from onlinebayes.transforms import ParameterRandomization
from recipes.pendulum import state

SPACE = ParameterSpace({"length": Parameter(0.1, 1.0, "m")})


def test_the_true_delay_is_the_likeliest() -> None:
    seed_everything(0)
    simulator = Pendulum(SPACE).with_effect(ActuatorDelay("motor", Parameter(0.0, 0.2, "s")))
    problem = Problem(simulator, PendulumTask(), BoxUniform(simulator.parameters))
    truth = torch.tensor([0.6, 0.13], dtype=torch.float64)
    env = problem.worlds(3, ParameterRandomization(Point(truth)), 0)
    data = trajectories(env, sac(*problem.specs).policy, 40)
    box = Box.whole(simulator.parameters)
    model = filter_of(simulator, problem.task, box, state=state)
    rows = Rows(data["observation"][:, 0].double(), data["action"], data["next", "observation"].double(), data["mask"])
    model.noise.fill_(0.01)
    model.begin_at(rows.first)
    delays = torch.tensor([0.0, 0.05, 0.10, 0.13, 0.16, 0.2], dtype=torch.float64)
    at = torch.stack([torch.full_like(delays, 0.6), delays], dim=1)
    found = [float(model.log_likelihood(rows, z.expand(3, -1)).sum()) for z in box.to_frame(at)]
    assert max(found) == found[3]
    evidence = model(rows, box.to_frame(truth).expand(3, -1))
    assert (evidence.innovation.mean(1) < 0.5).all(), "nothing is left at the truth but rounding"
