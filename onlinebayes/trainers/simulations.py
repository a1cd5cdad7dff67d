"""Trajectories of simulated worlds under a policy: for a fit, and in groups of one theta to hold the belief against.

x_i ~ simulator(theta_i, pi),   theta_i ~ proposal                            (B, T)
x_gj ~ simulator(theta_g, pi_j),   theta_g ~ proposal, j = 1 ... n            (G, n, T)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor
from torchrl.envs import EnvBase

from onlinebayes.trainers.env_state import env_state, load_env_state
from onlinebayes.trainers.trajectories import Policy, TrajectoryFormat, trajectories
from onlinebayes.transforms import Distribution, ParameterRandomization


@dataclass(frozen=True)
class Point:
    """The distribution that always gives the same theta (P,)."""

    theta: Float[Tensor, " P"]

    def sample(self, shape: tuple[int, ...], /) -> Tensor:
        """Theta (*shape, P)."""
        return self.theta.expand(*shape, -1)


@dataclass(frozen=True)
class Listed:
    """Gives the rows of a table (N, P) in order; an episode that begins beyond it gets the first rows again."""

    theta: Float[Tensor, "N P"]

    def sample(self, shape: tuple[int, ...], /) -> Tensor:
        """Theta (*shape, P)."""
        index = torch.arange(torch.Size(shape).numel(), device=self.theta.device) % len(self.theta)
        return self.theta[index].reshape(*shape, -1)


@runtime_checkable
class TrajectorySource(Protocol):
    """Gives a trainer its simulated trajectories, and can say where it stands."""

    form: TrajectoryFormat

    def draw(self, policies: Sequence[Policy], proposal: Distribution) -> TensorDict:
        """N trajectories (N, T) under each policy, every one with a theta of its own."""

    def groups(self, policies: Sequence[Policy], proposal: Distribution) -> TensorDict:
        """N groups (N, n, T): the same theta under each of the n policies."""

    def state_dict(self) -> dict[str, Any]:
        """Plain values."""

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Stand there again."""


class Simulations:
    """Worlds that are asked for trajectories.

    Args:
        env: batch size (N,), below the transform ``randomization``.
        randomization: draws their theta.
        steps: length T of a trajectory.
        form: which keys make up a trajectory.
        repeats: how often the worlds are run, for environments of few worlds.
    """

    def __init__(
        self,
        env: EnvBase,
        randomization: ParameterRandomization,
        steps: int,
        form: TrajectoryFormat | None = None,
        *,
        repeats: int = 1,
    ) -> None:
        self.env, self.steps, self.repeats = env, steps, repeats
        self.form = form if form is not None else TrajectoryFormat()
        self._randomization = randomization

    def draw(self, policies: Sequence[Policy], proposal: Distribution) -> TensorDict:
        """N trajectories (N, T) under each policy, ``repeats`` times, every one with a theta of its own."""
        self._randomization.set_distribution(proposal)
        each = [policy for policy in policies for _ in range(self.repeats)]
        return torch.cat([trajectories(self.env, policy, self.steps, self.form) for policy in each])

    def groups(self, policies: Sequence[Policy], proposal: Distribution) -> TensorDict:
        """N groups (N, n, T), ``repeats`` times: the same theta under each of the n policies."""
        parts = []
        for _ in range(self.repeats):
            theta = proposal.sample((self.env.batch_size.numel(),))
            self._randomization.set_distribution(Listed(theta))
            each = [trajectories(self.env, policy, self.steps, self.form) for policy in policies]
            parts.append(torch.stack(each, dim=1))
        return torch.cat(parts)

    def state_dict(self) -> dict[str, Any]:
        """Return the state of the worlds and their sensors."""
        return env_state(self.env)

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Stand there again."""
        load_env_state(self.env, state)
