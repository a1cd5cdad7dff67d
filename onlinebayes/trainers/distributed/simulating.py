"""Trajectories for a fit from many workers: theta is drawn here, simulated there, and comes back in order.

    theta_i ~ proposal       here, in one draw
    chunk c of them          a job: (theta_c, policy, seed_c) -> x_c ~ simulator(theta_c, pi)

A job is decided by its argument alone, so that one that was lost with its worker gives the same again, and all that a
run has to remember is how often it has asked.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor
from torchrl.envs import EnvBase

from onlinebayes.runs import OwnRandom, seed_of
from onlinebayes.trainers.distributed.collecting import shares
from onlinebayes.trainers.distributed.workers import Workers
from onlinebayes.trainers.simulations import Listed
from onlinebayes.trainers.state import frozen
from onlinebayes.trainers.trajectories import Policy, TrajectoryFormat, trajectories
from onlinebayes.transforms import Distribution, ParameterRandomization

MakeWorlds = Callable[[int, ParameterRandomization, int], EnvBase]
"""(number, transform that draws theta, seed) -> an environment; a problem's ``worlds``. Travels by pickle."""


@dataclass(frozen=True)
class Chunk:
    """A job: trajectories (n, T) of these parameters (n, P) under one policy."""

    worlds: MakeWorlds
    theta: Float[Tensor, "n P"]
    policy: Policy
    steps: int
    form: TrajectoryFormat
    seed: int


def simulated(chunk: Chunk) -> TensorDict:
    """Do the job."""
    drawn = ParameterRandomization(Listed(chunk.theta), theta_key=chunk.form.theta)
    with OwnRandom(chunk.seed).own():
        env = chunk.worlds(len(chunk.theta), drawn, chunk.seed)
        try:
            return trajectories(env, chunk.policy, chunk.steps, chunk.form)
        finally:
            env.close(raise_if_closed=False)


class PartedSimulations:
    """In the place of :class:`~onlinebayes.trainers.Simulations`; a draw is divided among workers.

    Args:
        worlds: gives them; a problem's ``worlds``.
        number: N of trajectories of one draw under one policy.
        steps: length T of a trajectory.
        workers: simulate.
        seed: of worlds, sensors and the policies' choices.
        form: which keys make up a trajectory.
        most: worlds of one job at most; without it each draw is one job a worker.
    """

    def __init__(
        self,
        worlds: MakeWorlds,
        number: int,
        steps: int,
        workers: Workers,
        seed: int,
        form: TrajectoryFormat | None = None,
        *,
        most: int | None = None,
    ) -> None:
        self.number, self.steps = number, steps
        self.form = form if form is not None else TrajectoryFormat()
        self._worlds, self._workers, self._seed = worlds, workers, seed
        least = 1 if most is None else -(-number // most)
        self._shares = shares(number, max(workers.number, least))
        self._draws = 0

    def draw(self, policies: Sequence[Policy], proposal: Distribution) -> TensorDict:
        """N trajectories (N, T) under each policy, every one with a theta of its own."""
        return torch.cat(self._simulated(policies, [proposal.sample((self.number,)) for _ in policies]))

    def groups(self, policies: Sequence[Policy], proposal: Distribution) -> TensorDict:
        """N groups (N, n, T): the same theta under each of the n policies."""
        theta = proposal.sample((self.number,))
        return torch.stack(self._simulated(policies, [theta] * len(policies)), dim=1)

    def state_dict(self) -> dict[str, Any]:
        """Return the number of draws so far, which the next seeds follow from."""
        return {"draws": self._draws}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from there."""
        self._draws = state["draws"]

    def _simulated(self, policies: Sequence[Policy], thetas: Sequence[Tensor]) -> list[TensorDict]:
        """For each policy the trajectories (N, T) of its parameters (N, P)."""
        chunks = [
            Chunk(self._worlds, theta, policy, self.steps, self.form, seed_of(self._seed, f"{self._draws} {i} {j}"))
            for i, (policy, whole) in enumerate(zip(map(frozen, policies), thetas, strict=True))
            for j, theta in enumerate(whole.detach().split(self._shares))
        ]
        self._draws += 1
        done = dict(self._workers.work(simulated, chunks))
        found, size = [done[i] for i in range(len(chunks))], len(self._shares)
        return [torch.cat(found[i : i + size]) for i in range(0, len(found), size)]
