"""A real system that is moved on purpose, within limits that its owner gives, where its policy hardly moves it.

    m = mean_i (max_t q_it - min_t q_it)           how far the policy's trajectories move what shall move
    m < least:    x <- x and n further trajectories of T steps

Their actions are drawn from what is allowed and held for h steps each; outside the limits the action leads back.

A policy that balances a cart trembles about one place, and says little of the friction on its way: what never slides
can be stuck or heavy. A recording of a few seconds that lets it slide tells the two apart.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, final

import torch
from jaxtyping import Bool, Float
from tensordict import NestedKey, TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.data import TensorSpec

from onlinebayes.runs import BadInput, Stateful
from onlinebayes.trainers.real import RealSystem, answer, united
from onlinebayes.trainers.trajectories import Policy


@dataclass(frozen=True)
class Limits:
    """Limits within which a machine may move while it is excited.

    Args:
        low, high: of each observed value (O,); infinite where there is no limit.
        back: observations (N, O) outside them -> the actions that lead back.

    Raises:
        BadInput: limits that are crossed.
    """

    low: Float[Tensor, " O"]
    high: Float[Tensor, " O"]
    back: Callable[[Tensor], Tensor]

    def __post_init__(self) -> None:
        if self.low.shape != self.high.shape or not bool((self.low < self.high).all()):
            raise BadInput(
                f"limits from {self.low.tolist()} to {self.high.tolist()}", "give a low and a higher high for each"
            )

    def passed(self, observation: Float[Tensor, "*n O"]) -> Bool[Tensor, "*n"]:
        """Check whether an observation lies outside."""
        return ((observation < self.low.to(observation)) | (observation > self.high.to(observation))).any(-1)


@final
class HeldActions(TensorDictModuleBase):
    """Actions drawn from what is allowed and held, by torch's global random numbers; outside the limits the way back.

    Args:
        allowed: spec of one world's action, as narrow as its owner wants it.
        hold: steps h from one draw to the next.
        limits: where the machine may be.
        observation_key, action_key: of both.

    Raises:
        BadInput: actions that are held for no step.
    """

    def __init__(
        self,
        allowed: TensorSpec,
        hold: int,
        limits: Limits,
        *,
        observation_key: NestedKey = "observation",
        action_key: NestedKey = "action",
    ) -> None:
        super().__init__()
        if hold < 1:
            raise BadInput(f"actions held for {hold} steps", "hold them for one or more")
        self.in_keys, self.out_keys = [observation_key], [action_key]
        self._allowed, self._hold, self._limits = allowed, hold, limits
        self._left, self._held = 0, torch.empty(0)

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Writes the action."""
        observation, batch = tensordict.get(self.in_keys[0]), tensordict.batch_size
        if not self._left or self._held.shape[: len(batch)] != batch:
            self._held, self._left = self._allowed.rand(batch), self._hold
        self._left -= 1
        outside = self._limits.passed(observation).reshape(*batch, *[1] * (self._held.ndim - len(batch)))
        return tensordict.set(self.out_keys[0], torch.where(outside, self._limits.back(observation), self._held))


@final
class Excited:
    """A real system that is also excited, where the policy hardly moves it.

    Args:
        system: the real one.
        excitation: a policy that is safe, such as :class:`HeldActions`.
        moved: trajectories (n, T) with their ``"mask"`` -> how far each moved (n,).
        least: mean of that from which on the policy moves it enough, in the unit of ``moved``.
        steps: T, of an excitation.
        most: excitations in a run.

    Raises:
        BadInput: a number that is not positive.
    """

    def __init__(
        self,
        system: RealSystem,
        excitation: Policy,
        moved: Callable[[TensorDict], Float[Tensor, " n"]],
        *,
        least: float,
        steps: int,
        most: int = 1,
    ) -> None:
        if not (least > 0 and steps > 0 and most > 0):
            raise BadInput(f"least {least:g}, steps {steps}, most {most}", "they have to be positive")
        self._system, self._excitation, self._moved = system, excitation, moved
        self._least, self._steps, self._most, self._asked = least, steps, most, 0

    @property
    def asked(self) -> int:
        """Excitations so far."""
        return self._asked

    def run(self, policy: Policy, steps: int) -> TensorDict | None:
        """The policy's trajectories, and those of an excitation where they hardly move."""
        seen = answer(self._system, policy, steps)
        if seen is None or self._asked >= self._most or float(self._moved(seen).mean()) >= self._least:
            return seen
        self._asked += 1
        more = answer(self._system, self._excitation, self._steps)
        return seen if more is None else united([seen, more])

    def state_dict(self) -> dict[str, Any]:
        """Return the number of calls so far, and the state of the system."""
        return {
            "asked": self._asked,
            "system": self._system.state_dict() if isinstance(self._system, Stateful) else None,
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Stand there again."""
        self._asked = state["asked"]
        if isinstance(self._system, Stateful) and state["system"] is not None:
            self._system.load_state_dict(state["system"])


def range_of(column: int, key: NestedKey = "observation") -> Callable[[TensorDict], Float[Tensor, " n"]]:
    """Build a statistic: the range of one observed value within each trajectory (n, T), in its unit."""

    def moved(seen: TensorDict) -> Float[Tensor, " n"]:
        value = seen.get(key)[..., column]
        mask = seen.get("mask", torch.ones_like(value, dtype=torch.bool))
        high = value.masked_fill(~mask, -torch.inf).amax(-1)
        low = value.masked_fill(~mask, torch.inf).amin(-1)
        return torch.where(mask.any(-1), high - low, 0.0)

    return moved
