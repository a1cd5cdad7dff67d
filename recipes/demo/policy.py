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
from onlinebayes.inference import Belief
from onlinebayes.objectives import PPO, ppo
from onlinebayes.simulators import Identifiable, SimulatorEnv
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.trainers import Problem, collector_of, improve
from onlinebayes.transforms import ParameterRandomization


@dataclass(frozen=True)
class Training:
    """How much training: ``batches`` x ``steps`` x ``worlds`` frames.

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


def train(simulator: Identifiable, worlds_from: Belief, how: Training, seed: int, say: Callable[[str], None]) -> PPO:
    """Train in worlds of ``simulator`` whose parameters come from ``worlds_from``."""
    torch.manual_seed(seed)
    task, frames = BalanceTask(), how.worlds * how.steps
    problem = Problem(training_worlds(simulator, how, task.period), task, worlds_from)
    objective = ppo(
        *problem.specs,
        frames_per_batch=frames,
        minibatch=frames // 4,
        epochs=6,
        gamma=0.98,
        lmbda=0.9,
        entropy=0.002,
    )
    env = problem.worlds(how.worlds, ParameterRandomization(worlds_from), seed)

    def told(batch: int, frames: int, losses: dict[str, float]) -> bool:
        if batch % max(1, how.batches // 4) == 0:
            say(f"{batch * frames} frames, critic's loss {losses['loss_critic']:.3g}")
        return True

    improve(objective, collector_of(env, objective.policy, how.steps), how.batches, told)
    return objective


@torch.no_grad()
def episodes(policy: torch.nn.Module, truth: Mapping[str, float], number: int, seed: int) -> TensorDict:
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
