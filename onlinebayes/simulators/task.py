"""A task: what is observed, rewarded and ended, whatever simulates the worlds.

    s_0 ~ start(theta),   o_k = observe(s_k),   r_k = reward(s_k, a_k, s_{k+1}),   over at ``terminated`` or ``horizon``

A task with goals also says which goal a state has reached, and what a step is worth for any goal, so that an episode
can be told again as if what it reached had been its goal (Andrychowicz et al. 2017, Hindsight Experience Replay).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Generator, Tensor
from torchrl.data import TensorSpec

from onlinebayes.runs import BadInput


class Task(ABC):
    """Observations, rewards and ends of episodes; a task knows nothing of how the worlds are simulated.

    Attributes:
        observation_size: width O of an observation.
        observation_sizes: key -> width, for a task whose :meth:`observe` gives several; empty for one observation.
        action_spec: TorchRL spec of one world's action, without a batch size.
        horizon: steps after which an episode is truncated.
        channels: key of an observation, or ``"action"`` -> name -> SI unit of each column (of each choice, where the
            action is discrete), for the card of a policy; what is not named gets numbers.
    """

    observation_size: int
    observation_sizes: Mapping[str, int] = {}
    action_spec: TensorSpec
    horizon: int
    channels: Mapping[str, Mapping[str, str]] = {}

    @abstractmethod
    def start(self, theta: Float[Tensor, "n P"], generator: Generator) -> TensorDict:
        """Initial states of n worlds, batch size (n,): ``"qpos"`` and ``"qvel"`` in theta's dtype and device.

        Leaves under ``"task"`` (a goal) stay as they are within an episode, and stand in every state that the task is
        shown.
        """

    @abstractmethod
    def observe(self, state: TensorDictBase) -> Float[Tensor, "N O"] | dict[str, Tensor]:
        """Return the policy's observation of a state, in float32: one tensor, or one for each of the keys."""

    @abstractmethod
    def command(self, action: Tensor) -> Float[Tensor, "N U"]:
        """The simulator's commands for an action (N, ...)."""

    @abstractmethod
    def reward(self, state: TensorDictBase, action: Tensor, after: TensorDictBase) -> Float[Tensor, " N"]:
        """Reward of the step from ``state`` to ``after``."""

    @abstractmethod
    def terminated(self, state: TensorDictBase) -> Bool[Tensor, " N"]:
        """Return a mask of the states that end the episode."""


@runtime_checkable
class GoalTask(Protocol):
    """The interface of a task with goals, besides :class:`Task`.

    Attributes:
        goal_size: width G of a goal.
    """

    goal_size: int

    def goal_reward(self, achieved: Float[Tensor, "*batch G"], desired: Float[Tensor, "*batch G"]) -> Tensor:
        """Reward (*batch) of a step that ends where ``achieved`` is reached, for any desired goal."""
        ...

    def success(self, achieved: Float[Tensor, "*batch G"], desired: Float[Tensor, "*batch G"]) -> Tensor:
        """Check whether ``achieved`` is as good as ``desired`` (*batch)."""
        ...


def check_observations(task: Task, values: Mapping[Any, Tensor], sizes: Mapping[Any, int], worlds: int) -> None:
    """Raise BadInput unless a task's observations have the keys and widths that it says."""
    wanted = {key: (worlds, size) for key, size in sizes.items()}
    found = {key: tuple(value.shape) for key, value in values.items()}
    if found != wanted:
        raise BadInput(
            f"{type(task).__name__}.observe gave {found} for {worlds} worlds, the task says {wanted}",
            "make observation_size (or observation_sizes) and observe agree",
        )


def check_reward(task: Task, reward: Tensor, worlds: int) -> None:
    """Raise BadInput unless a task's reward is one number a world."""
    if reward.shape != (worlds,):
        raise BadInput(
            f"{type(task).__name__}.reward gave shape {tuple(reward.shape)} for {worlds} worlds",
            f"give one number a world, shape ({worlds},)",
        )
