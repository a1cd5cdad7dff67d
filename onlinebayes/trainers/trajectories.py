"""Run a policy and keep what inference or a judge needs: whole trajectories, and returns.

G_i = sum_{t < T_i} r_{i,t},     T_i the end of world i's first episode
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import torch
from jaxtyping import Bool, Float
from tensordict import NestedKey, TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType, set_exploration_type

from onlinebayes.runs import heed

Policy: TypeAlias = TensorDictModuleBase
"""``"observation"`` -> ``"action"``."""


@dataclass(frozen=True)
class TrajectoryFormat:
    """Keys of a rollout that make up a trajectory.

    Attributes:
        keys: kept as they are.
        theta: key of the parameters.
        done: key of the end of an episode.
    """

    keys: tuple[NestedKey, ...] = ("observation", "action", ("next", "observation"), ("next", "reward"))
    theta: NestedKey = "theta"
    done: NestedKey = ("next", "done")


@torch.no_grad()
def trajectories(env: EnvBase, policy: Policy, steps: int, form: TrajectoryFormat | None = None) -> TensorDict:
    """One trajectory from each world of ``env``, from a fresh reset, by the policy as it explores.

    Args:
        env: batch size (N,).
        policy: ``"observation"`` -> ``"action"``.
        steps: length T; an episode that ends sooner is padded.
        form: which keys make up a trajectory.

    Returns:
        Batch size (N, T): ``"observation"``, ``"action"``, ``("next", "observation")``, ``("next", "reward")``,
        ``"mask"`` (N, T), False after the first episode's end, and ``"theta"`` (N, T, P) where the environment has one.
    """
    form = form if form is not None else TrajectoryFormat()
    with set_exploration_type(ExplorationType.RANDOM):
        data = rolled_out(env, policy, steps)
    result = data.select(*form.keys)
    result["mask"] = first_episode(data, form.done)
    theta = data.get(form.theta, None)
    if theta is not None:
        result[form.theta] = theta[:, :1].expand(*data.shape, -1).clone()
    return result


@torch.no_grad()
def returns(env: EnvBase, policy: Policy, steps: int) -> Float[Tensor, " N"]:
    """Undiscounted return of each world's first episode under the policy's deterministic action.

    Args:
        env: batch size (N,).
        policy: ``"observation"`` -> ``"action"``.
        steps: longest episode that counts.
    """
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        data = rolled_out(env, policy, steps)
    return (data["next", "reward"].squeeze(-1) * first_episode(data)).sum(-1)


def rolled_out(env: EnvBase, policy: Policy, steps: int, *, to_end: bool = False) -> TensorDict:
    """A rollout (*batch, T) that ends early where the block in hand is to end.

    Args:
        env: the worlds.
        policy: ``"observation"`` -> ``"action"``.
        steps: longest length T.
        to_end: whether it stops where an episode ends; else worlds begin new ones.

    Raises:
        Stopped: the block in hand was asked to end.
    """
    heed()
    return env.rollout(steps, policy, break_when_any_done=to_end, callback=lambda *_: heed())


def first_episode(data: TensorDictBase, done: NestedKey = ("next", "done")) -> Bool[Tensor, "N T"]:
    """True up to the end of each world's first episode."""
    over = data.get(done).squeeze(-1).long()
    return (over.cumsum(-1) - over) == 0
