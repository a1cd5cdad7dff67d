"""A policy for the balance task, trained in worlds drawn from a posterior, and its episodes on the rig."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import mujoco
import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor
from torchrl.envs.utils import ExplorationType, set_exploration_type

from envs.driven_pendulum import MODEL, BalanceTask, DrivenPendulumRig
from onlinebayes.inference import Belief, BoxUniform
from onlinebayes.objectives import PPO, PPOSettings, ppo
from onlinebayes.simulators import Identifiable, SimulatorEnv
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.trainers import Policy, Problem, SimulatedPlayer, collector_of, improve
from onlinebayes.transforms import ParameterRandomization

Told = Callable[[int, dict[str, float]], None]
"""(frames since the last call, losses of the last batch)"""


@dataclass(frozen=True)
class Training:
    """Amount of training: ``batches`` x ``steps`` x ``worlds`` frames.

    Args:
        worlds: simulated at once.
        steps: of each world in a batch.
        batches: the policy learns from.
        timestep: of the simulation [s]; RK4 at 10 ms errs by less than the encoder's step.
    """

    worlds: int = 256
    steps: int = 32
    batches: int = 60
    timestep: float = 0.01


def training_worlds(simulator: Identifiable, how: Training, period: float) -> MujocoSimulator:
    """The model with its effects, one step a control period."""
    spec = mujoco.MjSpec.from_file(str(MODEL))
    spec.option.timestep = how.timestep
    own = simulator.parameters.subspace(name for name in simulator.parameters if "@" not in name)
    return MujocoSimulator(spec, own, 1, period, threads=1, effects=simulator.effects)


def learner(simulator: Identifiable, worlds_from: Belief, how: Training, seed: int) -> tuple[Problem, PPO]:
    """The balance task in worlds of ``simulator`` with parameters from ``worlds_from``, and who is to learn it."""
    task = BalanceTask()
    problem = Problem(training_worlds(simulator, how, task.period), task, worlds_from)
    return problem, balance_ppo(problem, how, seed)


def balance_ppo(problem: Problem, how: Training, seed: int) -> PPO:
    """PPO for the balance task, nothing learnt yet."""
    torch.manual_seed(seed)
    frames = how.worlds * how.steps
    settings = PPOSettings(
        frames_per_batch=frames, minibatch=frames // 4, epochs=6, gamma=0.98, lmbda=0.9, entropy=0.002
    )
    return ppo(*problem.specs, settings)


def train(problem: Problem, objective: PPO, how: Training, seed: int, told: Told) -> None:
    """Train the policy, and tell four times how far it is."""
    env = problem.worlds(how.worlds, ParameterRandomization(problem.prior), seed)
    every = max(1, how.batches // 4)

    def after(batch: int, frames: int, losses: dict[str, float]) -> bool:
        if batch % every == 0:
            with torch.random.fork_rng():  # whoever is told may draw
                told(every * frames, losses)
        return True

    improve(objective, collector_of(env, objective.policy, how.steps), how.batches, after)


def player(problem: Problem, policy: Policy, truth: Mapping[str, float]) -> SimulatedPlayer:
    """Plays the policy on the rig of the given truth, and its commands in the model."""
    rig = DrivenPendulumRig(1, dt=problem.simulator.dt)
    system = Problem(rig, problem.task, BoxUniform(rig.parameters))
    return SimulatedPlayer(problem, policy, rig.parameters.vector(truth), system)


def score(policy: Policy, truth: Mapping[str, float], number: int, seed: int) -> float:
    """Mean return of :func:`episodes`."""
    return float(returns(episodes(policy, truth, number, seed)).mean())


@torch.no_grad()
def episodes(policy: Policy, truth: Mapping[str, float], number: int, seed: int) -> TensorDict:
    """Episodes of the policy's mean action on rigs of the given truth, batch size (number, horizon)."""
    task = BalanceTask()
    rig = DrivenPendulumRig(number, dt=task.period)
    rig.reset(rig.parameters.vector(truth).expand(number, -1).clone())
    env = SimulatorEnv(rig, task, seed=seed)
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        return env.rollout(task.horizon, policy, break_when_any_done=False)


def returns(played: TensorDict) -> Float[Tensor, " N"]:
    """Undiscounted return of each first episode."""
    done = played["next", "done"][..., 0].long()
    first = (done.cumsum(-1) - done) == 0
    return (played["next", "reward"][..., 0] * first).sum(-1)
