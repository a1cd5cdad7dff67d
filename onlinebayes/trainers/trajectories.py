"""Run a policy and keep what inference or a judge needs: whole trajectories, returns, a system that is out of reach.

G_i = sum_{t < T_i} r_{i,t},     T_i the end of world i's first episode
"""

from __future__ import annotations

from typing import Protocol, TypeAlias, runtime_checkable

import torch
from jaxtyping import Float
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType, set_exploration_type

Policy: TypeAlias = TensorDictModuleBase
"""``"observation"`` -> ``"action"``."""
KEYS = ("observation", "action", ("next", "observation"), ("next", "reward"))


@runtime_checkable
class RealSystem(Protocol):
    """The system the physics of which are in question: it runs a policy and gives what its sensors saw."""

    def run(self, policy: Policy, steps: int) -> TensorDict:
        """One trajectory of batch size (1, ``steps``), with the keys that :func:`trajectories` gives but no theta."""


class HiddenSystem:
    """A simulated stand-in for a real system; neither its environment nor its theta can be had from it.

    Args:
        env: of batch size (1,), already in the world that plays the real one.
    """

    __slots__ = ("_run",)

    def __init__(self, env: EnvBase) -> None:
        def run(policy: Policy, steps: int) -> TensorDict:
            return trajectories(env, policy, steps).exclude("theta")

        self._run = run

    def run(self, policy: Policy, steps: int) -> TensorDict:
        """One trajectory of batch size (1, ``steps``)."""
        return self._run(policy, steps)


@torch.no_grad()
def trajectories(env: EnvBase, policy: Policy, steps: int) -> TensorDict:
    """One trajectory from each world of ``env``, from a fresh reset, by the policy as it explores.

    Args:
        env: batch size (N,).
        policy: ``"observation"`` -> ``"action"``.
        steps: length T; an episode that ends sooner is padded.

    Returns:
        Batch size (N, T): ``"observation"``, ``"action"``, ``("next", "observation")``, ``("next", "reward")``,
        ``"mask"`` (N, T), False after the first episode's end, and ``"theta"`` (N, T, P) where the environment has one.
    """
    with set_exploration_type(ExplorationType.RANDOM):
        data = env.rollout(steps, policy, break_when_any_done=False)
    result = data.select(*KEYS)
    result["mask"] = _first_episode(data)
    theta = data.get("theta", None)
    if theta is not None:
        result["theta"] = theta[:, :1].expand(*data.shape, -1).clone()
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
        data = env.rollout(steps, policy, break_when_any_done=False)
    return (data["next", "reward"].squeeze(-1) * _first_episode(data)).sum(-1)


def _first_episode(data: TensorDictBase) -> Tensor:
    done = data["next", "done"].squeeze(-1).long()
    return (done.cumsum(-1) - done) == 0
