"""Batches of a policy from worlds in parts, each part with a worker; which of them dies, and when, changes nothing.

    question   policy's weights, distribution of theta, where the part stood after its last batch
    answer     batch (N_i, T), where the part stands now

A part is a TorchRL ``Collector`` with random numbers of its own. It stays with its worker and goes on from batch to
batch; one that was built anew, in the place of another that died, first goes to where that one stood. So all that has
to be kept is what this process has, and the next batch is decided by it to the last bit. Worlds that cannot say where
they stand, robots and Gymnasium's games, begin new episodes in place of those that were lost.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.envs import EnvBase

from onlinebayes.runs import OwnRandom, seed_of
from onlinebayes.trainers.collecting import collector_of
from onlinebayes.trainers.distributed.workers import Station, Workers
from onlinebayes.trainers.env_state import collector_state, load_collector_state
from onlinebayes.trainers.state import frozen
from onlinebayes.trainers.trajectories import Policy
from onlinebayes.transforms import Distribution, ParameterRandomization

MakeEnv = Callable[[ParameterRandomization], EnvBase]
"""The transform that draws theta -> an environment below it. Travels by pickle."""


@dataclass(frozen=True)
class Question:
    """The request to a part for its next batch.

    Args:
        weights: of the policy.
        distribution: of theta.
        begin: new episodes in every world first.
        stand: where it stood after its last batch; None before the first.
        mark: of that batch; a part that gave another one last has to go there.
        following: mark of the batch that is asked for.
    """

    weights: Mapping[str, Any]
    distribution: Distribution
    begin: bool
    stand: Mapping[str, Any] | None
    mark: tuple[int, int]
    following: tuple[int, int]


class Part:
    """Some of the worlds, in a worker."""

    def __init__(self, make: MakeEnv, policy: Policy, steps: int, drawn: ParameterRandomization, seed: int) -> None:
        self._random, self._policy, self._drawn = OwnRandom(seed), policy, drawn
        with self._random.own():
            self._collector = collector_of(make(drawn), policy, steps)
        self._mark: tuple[int, int] | None = None

    def __call__(self, question: Question) -> tuple[TensorDictBase, dict[str, Any]]:
        """The next batch, and where the part stands after it."""
        self._policy.load_state_dict(question.weights)
        self._drawn.set_distribution(question.distribution)
        known = True
        if question.stand is not None and question.mark != self._mark:
            known = self._go_to(question.stand)
        with self._random.own():
            if question.begin or not known:
                self._collector.reset()
            batch = self._collector.next()
        self._mark = question.following
        assert batch is not None, "the collector has no end"
        return batch, {"collector": collector_state(self._collector), "random": self._random.state}

    def _go_to(self, stand: Mapping[str, Any]) -> bool:
        """Stand there; False where the worlds have to begin new episodes."""
        with self._random.own():
            known = load_collector_state(self._collector, stand["collector"])
        self._random.state = dict(stand["random"])
        return known


class PartedCollector:
    """Batches (N, ``steps``) of a policy in worlds in parts, without end: the parts' rows one below the other.

    Args:
        makes: one environment each, batch size (N_i,); see :func:`in_parts`.
        policy: whose weights are looked up before each batch.
        steps: length T of a batch.
        drawn: whose distribution of theta is looked up before each batch.
        workers: the parts stay with them.
        seed: of the parts' random numbers.
    """

    def __init__(
        self,
        makes: Sequence[MakeEnv],
        policy: Policy,
        steps: int,
        drawn: ParameterRandomization,
        workers: Workers,
        seed: int,
    ) -> None:
        self._policy, self._drawn, self._workers = policy, drawn, workers
        self._parts = [
            partial(_part, make, frozen(policy), steps, drawn.distribution, drawn.theta_key, seed_of(seed, f"part {i}"))
            for i, make in enumerate(makes)
        ]
        self._ask: Station | None = None
        self._stand: list[dict[str, Any]] | None = None
        self._begin = False
        self._times, self._batches = 0, 0  # that it was loaded, and that it has given

    def reset(self) -> None:
        """Begin a new episode in every world, with the next batch."""
        self._begin = True

    def next(self) -> TensorDict:
        """The next batch (N, T)."""
        if self._ask is None:
            self._ask = self._workers.station(self._parts)
        stand = self._stand if self._stand is not None else [None] * len(self._parts)
        weights, mark = self._policy.state_dict(), (self._times, self._batches)
        following = (self._times, self._batches + 1)
        asked = [Question(weights, self._drawn.distribution, self._begin, each, mark, following) for each in stand]
        batches, self._stand = map(list, zip(*self._ask(asked), strict=True))
        self._begin, self._batches = False, self._batches + 1
        return torch.cat(batches)

    def state_dict(self) -> dict[str, Any]:
        """Return the state of each part, and whether new episodes are to begin."""
        return {"parts": self._stand, "begin": self._begin}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """The next batch is the one that would have come.

        Raises:
            ValueError: another number of parts.
        """
        parts = state["parts"]
        if parts is not None and len(parts) != len(self._parts):
            raise ValueError(f"saved in {len(parts)} parts, now there are {len(self._parts)}")
        self._stand, self._begin = None if parts is None else list(parts), state["begin"]
        self._times += 1


def in_parts(
    worlds: Callable[[int, ParameterRandomization, int], EnvBase], number: int, parts: int, seed: int
) -> list[MakeEnv]:
    """Worlds in parts of about the same size.

    Args:
        worlds: (number, transform that draws theta, seed) -> an environment; a problem's ``worlds``.
        number: of all worlds.
        parts: at most so many.
        seed: each part gets one of its own that follows from it.
    """
    return [partial(_worlds, worlds, n, seed_of(seed, f"worlds {i}")) for i, n in enumerate(shares(number, parts))]


def shares(number: int, parts: int) -> list[int]:
    """So many things divided as evenly as can be; no share is empty."""
    return [number // parts + (i < number % parts) for i in range(min(parts, number))]


def _worlds(
    worlds: Callable[[int, ParameterRandomization, int], EnvBase], number: int, seed: int, drawn: ParameterRandomization
) -> EnvBase:
    return worlds(number, drawn, seed)


def _part(make: MakeEnv, policy: Policy, steps: int, distribution: Distribution, theta_key: Any, seed: int) -> Part:
    return Part(make, frozen(policy), steps, ParameterRandomization(distribution, theta_key=theta_key), seed)
