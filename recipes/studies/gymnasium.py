"""``make gymnasium``: policies trained by our code in our worlds at default parameters, judged in Gymnasium's own.

| environment              | learnt by                                     | goal    |
|--------------------------|-----------------------------------------------|---------|
| CartPole-v1              | PPO                                           | >= 495  |
| Pendulum-v1              | SAC                                           | >= -160 |
| Acrobot-v1               | PPO                                           | >= -80  |
| MountainCar-v0           | PPO; engines of other strength in other worlds | >= -115 |
| MountainCarContinuous-v0 | SAC; engines of other strength in other worlds | >= 93   |

The two cars begin in worlds whose engines differ: where all are weak, no reward is ever met. MountainCar's second half
is learnt in the default world alone: one policy for all engines swings once more than this one needs. Each finished job
is kept, so that a second start goes on.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import gymnasium
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.envs.utils import ExplorationType, set_exploration_type

from envs.acrobot import Acrobot, AcrobotTask
from envs.cartpole import CartPole, CartPoleTask
from envs.mountain_car import MountainCar, MountainCarContinuous, MountainCarContinuousTask, MountainCarTask
from envs.pendulum import Pendulum, PendulumTask
from onlinebayes.experiments import status
from onlinebayes.inference import BoxUniform
from onlinebayes.objectives import Objective, PPOSettings, SACSettings, ppo, sac
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import ResultTable, seed_everything
from onlinebayes.simulators import Task, TorchSimulator
from onlinebayes.trainers import Point, Problem, collector_of
from onlinebayes.transforms import ParameterRandomization
from recipes.studies.jobs import Places, each_kept_or_done, finished, printed_by

EPISODES = 100


@dataclass(frozen=True)
class Case:
    """One environment and how a policy learns it.

    Args:
        simulator: ours.
        task: ours.
        space: parameters that differ between the worlds; none for the default ones.
        objective: specs -> policy and learning.
        worlds, steps, batches: how much.
        differ: batches of worlds whose parameters differ, before those at default parameters.
        goal: mean return, at least.
        episodes: of our worlds, by which the best policy along the way is chosen.
    """

    simulator: type[TorchSimulator]
    task: Task
    space: ParameterSpace
    objective: Callable[..., Objective]
    worlds: int
    steps: int
    batches: int
    differ: int
    goal: float
    episodes: int = 128


SAME = ParameterSpace({})
FORCE = ParameterSpace({"force": Parameter(0.0007, 0.003, "length/step2", "log")})
POWER = ParameterSpace({"power": Parameter(0.001, 0.006, "length/step2", "log")})
CASES = {
    "CartPole-v1": Case(CartPole, CartPoleTask(), SAME, ppo, 64, 64, 60, 0, 495.0),
    "Pendulum-v1": Case(
        Pendulum,
        PendulumTask(),
        SAME,
        partial(sac, settings=SACSettings(tau=0.02, gamma=0.98, reward_scale=0.1, alpha=0.3, frames_per_update=8)),
        64,
        16,
        60,
        0,
        -160.0,
    ),
    "Acrobot-v1": Case(
        Acrobot,
        AcrobotTask(),
        SAME,
        partial(ppo, settings=PPOSettings(learning_rate=3e-4, epochs=8)),
        64,
        64,
        120,
        0,
        -80.0,
        episodes=512,
    ),
    "MountainCar-v0": Case(
        MountainCar,
        MountainCarTask(),
        FORCE,
        partial(
            ppo,
            settings=PPOSettings(normalise=True, gamma=0.998, lmbda=1.0, frames_per_batch=8192, minibatch=1024),
        ),
        64,
        128,
        80,
        40,
        -115.0,
    ),
    "MountainCarContinuous-v0": Case(
        MountainCarContinuous,
        MountainCarContinuousTask(),
        POWER,
        partial(
            sac,
            settings=SACSettings(normalise=True, gamma=0.995, tau=0.01, reward_scale=0.1, alpha=0.1, memory=200_000),
        ),
        64,
        32,
        60,
        60,
        93.0,
    ),
}


@dataclass(frozen=True, kw_only=True)
class Study(Places):
    """All environments and seeds."""

    environments: tuple[str, ...] = tuple(CASES)
    """which"""
    seeds: tuple[int, ...] = (1, 2, 3, 4, 5)
    """of networks, worlds and draws"""
    out: str = "out/gymnasium"


def main(study: Study) -> int:
    """Train what is missing, print the table."""
    wanted = [(name, seed) for name in study.environments for seed in study.seeds]
    jobs = {(name, seed): partial(train, name, seed) for name, seed in wanted}
    found = each_kept_or_done("gymnasium", study.out, jobs, lambda job: f"{job[0]}-{job[1]}", study.ray_workers)
    table = ResultTable("gymnasium", printed_by("gymnasium", study), study.seeds)
    for name in study.environments:
        of = [found[name, seed] for seed in study.seeds]
        table.add_seeds(f"{name}: return", [one["score"] for one in of], least=CASES[name].goal)
        table.add(f"{name}: frames", of[0]["frames"], unit="frames")
    return finished(table, study.results, found)


def train(name: str, seed: int) -> dict[str, Any]:
    """Train one policy; of the policies along the way the one that is best in our worlds at default parameters.

    Returns:
        score, mean return over episodes of Gymnasium's environment; frames and seconds, what it took; course, the
        return in the course of learning.
    """
    start, case = time.monotonic(), CASES[name]
    seed_everything(seed)
    problem = Problem(case.simulator(case.space), case.task, BoxUniform(case.space))
    default = problem.simulator.nominal
    objective = case.objective(*problem.specs)
    best, kept, course = -float("inf"), objective.policy.state_dict(), []
    for batch, data in enumerate(batches(case, problem, objective, seed), 1):
        objective.update(data)
        if batch % 10 == 0:
            course.append(problem.score(objective.policy, default, episodes=case.episodes))
            if course[-1] > best:
                best, kept = course[-1], {k: v.clone() for k, v in objective.policy.state_dict().items()}
    objective.policy.load_state_dict(kept)
    frames = case.batches * case.worlds * case.steps
    score = judged(objective, name, seed)
    return {"score": score, "frames": frames, "seconds": time.monotonic() - start, "course": course}


def batches(case: Case, problem: Problem, objective: Objective, seed: int) -> Iterator[TensorDictBase]:
    """Draw the batches that a policy learns from: first in worlds that differ, then in default ones."""
    phases = ((case.differ, problem.prior), (case.batches - case.differ, Point(problem.simulator.nominal)))
    for number, thetas in phases:
        env = problem.worlds(case.worlds, ParameterRandomization(thetas), seed)
        collector = collector_of(env, objective.policy, case.steps)
        for _ in range(number):
            data = collector.next()
            assert data is not None
            yield data


@torch.no_grad()
def judged(objective: Objective, name: str, seed: int) -> float:
    """Mean return of the deterministic policy over episodes of Gymnasium's own environment."""
    envs = [gymnasium.make(name) for _ in range(EPISODES)]
    seen = [env.reset(seed=1000 * seed + i)[0] for i, env in enumerate(envs)]
    total, going = [0.0] * EPISODES, set(range(EPISODES))
    discrete = isinstance(envs[0].action_space, gymnasium.spaces.Discrete)
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        while going:
            rows = sorted(going)
            observed = torch.stack([torch.as_tensor(seen[i], dtype=torch.float32) for i in rows])
            action = objective.policy(TensorDict({"observation": observed}, batch_size=(len(rows),)))["action"]
            for i, a in zip(rows, action, strict=True):
                seen[i], reward, terminated, truncated, _ = envs[i].step(int(a.argmax()) if discrete else a.numpy())
                total[i] += float(reward)
                if terminated or truncated:
                    going.discard(i)
    return statistics.fmean(total)


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
