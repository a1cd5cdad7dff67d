"""The most that a window of a trajectory can tell of one parameter: the exact posterior of one who knows its start.

    p(theta | x) ~ p(theta) prod_t N(y_t; h(s_t(theta)), sd^2),    s_0 known, s_{t+1} = f(s_t, a_t, theta)

on a grid of theta, with the commands that were given. Whoever has to guess the start from noisy sensors knows less.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs.utils import ExplorationType, set_exploration_type, step_mdp

from onlinebayes.simulators import SimulatorEnv
from onlinebayes.trainers import Policy, Problem
from onlinebayes.transforms import ParameterRandomization

GRID = 200


@torch.no_grad()
def densities(problem: Problem, policy: Policy, number: int, begin: int, steps: int, seed: int) -> Tensor:
    """Log densities [nats] of the truths of those of ``number`` windows whose first episode lasts to their end."""
    env = problem.worlds(number, ParameterRandomization(problem.prior), seed)
    inner = env.base_env
    assert isinstance(inner, SimulatorEnv)
    with set_exploration_type(ExplorationType.RANDOM):
        now = env.reset()
        lasting = torch.ones(number, dtype=torch.bool)
        if begin:
            before = env.rollout(begin, policy, auto_reset=False, tensordict=now, break_when_any_done=False)
            lasting = ~before["next", "done"].any(1)[:, 0]
            now = env.maybe_reset(step_mdp(before[:, -1]))
        start = inner.simulator.state.select("qpos", "qvel").clone()
        data = env.rollout(steps, policy, auto_reset=False, tensordict=now, break_when_any_done=False)
    whole = lasting & ~data["next", "done"][:, :-1, 0].any(1)
    return torch.stack([density(problem, data[i], start[i]) for i in whole.nonzero()[:, 0].tolist()])


def density(problem: Problem, data: TensorDictBase, start: TensorDictBase) -> Float[Tensor, ""]:
    """Of the true parameter of one window (T,), from the state in which it began."""
    assert problem.sensor_sd is not None
    (parameter,), steps = problem.space.values(), len(data)
    grid = parameter.low + (parameter.high - parameter.low) * (torch.arange(GRID, dtype=torch.float64) + 0.5) / GRID
    theta = torch.cat([data[0]["theta"].double(), grid])[:, None]
    command = data["action"].expand(GRID + 1, -1, -1).contiguous()
    times = problem.simulator.dt * torch.arange(1, steps + 1, dtype=torch.float64)
    held = TensorDict({"command": command}, batch_size=[GRID + 1, steps])
    path = problem.simulator.rollout(theta, start.expand(GRID + 1).contiguous(), held, times)
    seen = problem.task.observe(path.select("qpos", "qvel").reshape(-1))
    assert isinstance(seen, Tensor)
    misfit = (data["next", "observation"] - seen.double().unflatten(0, (GRID + 1, steps))) / problem.sensor_sd
    likelihood = -0.5 * misfit.square().sum((1, 2))
    return likelihood[0] - likelihood[1:].logsumexp(0) - math.log((parameter.high - parameter.low) / GRID)
