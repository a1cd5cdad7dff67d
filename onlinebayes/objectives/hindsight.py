"""A replay buffer of episodes: goals told in hindsight, returns of several steps, demonstrations beside one's own.

    a transition t of an episode that ends at e, and with probability k / (k + 1) another goal for it:
        g = achieved_{u + 1},   u uniform in t .. e                                       (the strategy "future")
        R = sum_{i < m} gamma^i r(achieved_{t + i + 1}, g),   m = min(n, e - t + 1)
        (s_t, a_t, R, s_{t + m}, m)

Andrychowicz et al., Hindsight Experience Replay (2017). The number of steps m is written to ``"steps_to_next_obs"``,
which TorchRL's value estimators read.

Steps lie in a ring, one episode after the other, each with the number of steps that follow it in its episode. Episodes
may have any length, nothing is padded, and where the ring overwrites an episode it takes the first steps first, which
nothing later refers to.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, final

import torch
from jaxtyping import Bool, Float, Int
from tensordict import NestedKey, TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.objectives.buffer import TransitionBuffer
from onlinebayes.objectives.inputs import after
from onlinebayes.runs import BadInput

LEFT = "steps_left"
"""Key under which the ring keeps the number of steps that follow in the same episode."""

LEADS = "leads_elsewhere"
"""Key under which it keeps whether the episode ends elsewhere than it is at this step."""


@dataclass(frozen=True)
class Hindsight:
    """Relabelling of transitions with goals that were reached later.

    Args:
        reward: achieved goals (*batch, G), desired goals (*batch, G) -> rewards (*batch), as a task's ``goal_reward``.
        terminated: the same -> whether the episode ends there (*batch), for tasks that end at success; without it a
            transition keeps what was recorded.
        k: transitions with another goal for each one with its own.
        elsewhere: share of the transitions, one's own and the demonstrations', from steps that lead elsewhere: by the
            reward, the goal achieved at the episode's end is not the one that was achieved at the step. An object that
            is hardly ever touched teaches nothing else, as every goal told anew is where it lies.
        achieved_key: of the goal that a state has reached; read after the step.
        desired_key: of the goal that is told anew.
    """

    reward: Callable[[Tensor, Tensor], Tensor]
    terminated: Callable[[Tensor, Tensor], Tensor] | None = None
    k: float = 4.0
    elsewhere: float = 0.0
    achieved_key: NestedKey = "achieved_goal"
    desired_key: NestedKey = "desired_goal"


@final
class EpisodeReplay:
    """The last steps of episodes, dealt out at random as transitions; ``torch``'s global generator draws.

    Args:
        size: steps kept; the oldest are overwritten. Demonstrations are kept apart, as many again.
        minibatch: transitions of one sample.
        gamma: discount factor within a return.
        steps: n, of a return.
        hindsight: how goals are told anew; without it they stay.
        demonstrations: share of a minibatch that is drawn from demonstrations, once there are some.
        reward_key, done_key, terminated_key: below ``"next"``.
        mask_key: of the steps that are no padding, where a batch has it.
        device: where the steps lie.
    """

    def __init__(
        self,
        size: int,
        minibatch: int,
        *,
        gamma: float,
        steps: int = 1,
        hindsight: Hindsight | None = None,
        demonstrations: float = 0.0,
        reward_key: NestedKey = "reward",
        done_key: NestedKey = "done",
        terminated_key: NestedKey = "terminated",
        mask_key: NestedKey = ("collector", "mask"),
        device: torch.device | str | None = None,
    ) -> None:
        if steps < 1 or not 0 <= demonstrations <= 1:
            raise ValueError(f"steps = {steps}, demonstrations = {demonstrations}: at least 1; a share")
        self.minibatch, self.gamma, self.steps, self.share = minibatch, gamma, steps, demonstrations
        self.hindsight, self.mask_key = hindsight, mask_key
        self.reward_key, self.done_key, self.terminated_key = after(reward_key), after(done_key), after(terminated_key)
        self._own, self._shown = (TransitionBuffer(size, device=device) for _ in range(2))
        self._keys: list[NestedKey] = []
        self._leading: dict[TransitionBuffer, Int[Tensor, " n"]] = {}

    def __len__(self) -> int:
        """Steps of one's own that are there."""
        return len(self._own)

    def extend(self, data: TensorDictBase) -> None:
        """Remember a batch (N, T) of a collector, or one row (T,); an episode that a row cuts is truncated there.

        The first batch says which keys are kept.

        Raises:
            BadInput: a key that is needed is missing.
        """
        self._remember(self._own, data)

    def extend_demonstrations(self, data: TensorDictBase) -> None:
        """Remember a batch (N, T) that somebody else acted in."""
        self._remember(self._shown, data)

    def sample(self, batch_size: int | None = None) -> TensorDict:
        """Transitions at random, with replacement; uniform over the steps, but for :attr:`Hindsight.elsewhere`.

        Raises:
            ValueError: nothing was remembered yet.
        """
        number = self.minibatch if batch_size is None else batch_size
        if not len(self._own) and not len(self._shown):
            raise ValueError("the buffer is empty; extend it first")
        shown = round(self.share * number) if len(self._own) and len(self._shown) else number * bool(len(self._shown))
        rows = self._draw(self._shown, shown) if shown else {}
        if shown < number:
            own = self._draw(self._own, number - shown)
            rows = {key: torch.cat([value, rows[key]]) for key, value in own.items()} if rows else own
        return TensorDict(rows, batch_size=(number,), device=self._own.device)

    def state_dict(self) -> dict[str, Any]:
        """All steps, where the next ones go, and which keys are kept."""
        return {"keys": list(self._keys), "own": self._own.state_dict(), "shown": self._shown.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Remember what :meth:`state_dict` gave.

        Raises:
            BadInput: it is of a buffer of another size.
        """
        self._own.load_state_dict(state["own"])
        self._shown.load_state_dict(state["shown"])
        self._keys, self._leading = list(state["keys"]), {}

    def _remember(self, ring: TransitionBuffer, data: TensorDictBase) -> None:
        data = data if data.ndim > 1 else data.unsqueeze(0)
        keys = set(data.keys(True, True))
        needed = [self.reward_key, self.done_key, self.terminated_key, *self._keys]
        if self.hindsight:
            needed += [after(self.hindsight.achieved_key), self.hindsight.desired_key]
        missing = [key for key in needed if key not in keys]
        if missing:
            raise BadInput(
                f"the batch has no {missing[0]!r}, it has {sorted(map(str, keys))}", "name the key it goes by"
            )
        done = data[self.done_key].reshape(data.batch_size)
        mask = data[self.mask_key].reshape(done.shape) if self.mask_key in keys else torch.ones_like(done)
        self._keys = self._keys or sorted(keys - {self.mask_key}, key=str)
        left = steps_left(done, mask)
        rows = data.select(*self._keys).set(LEFT, left)
        if self.hindsight and self.hindsight.elsewhere:
            rows[LEADS] = leads_elsewhere(data[after(self.hindsight.achieved_key)], left, self.hindsight.reward)
        ring.extend(rows[mask])
        self._leading.pop(ring, None)

    def _starts(self, ring: TransitionBuffer, number: int) -> Int[Tensor, " B"]:
        """Steps at which transitions begin: uniform, but for a share of those that lead elsewhere."""
        start = torch.randint(len(ring), (number,), device=ring.device)
        if not self.hindsight or not self.hindsight.elsewhere:
            return start
        if ring not in self._leading:
            rows = torch.arange(len(ring), device=ring.device)
            self._leading[ring] = ring.at(rows, [LEADS])[LEADS].nonzero().squeeze(-1)
        leading, some = self._leading[ring], round(self.hindsight.elsewhere * number)
        if len(leading):
            start[:some] = leading[torch.randint(len(leading), (some,), device=ring.device)]
        return start

    def _draw(self, ring: TransitionBuffer, number: int) -> dict[Any, Tensor]:
        start = self._starts(ring, number)
        left = ring.at(start, [LEFT])[LEFT]
        offsets = torch.arange(self.steps, device=ring.device)
        window = start.unsqueeze(-1) + torch.minimum(offsets, left.unsqueeze(-1))
        told = ring.at(window, [self.reward_key, self.terminated_key])
        reward, terminated = told[self.reward_key].squeeze(-1), told[self.terminated_key].squeeze(-1)
        following = [key for key in self._keys if isinstance(key, tuple) and key[0] == "next"]
        rows = ring.at(start, [key for key in self._keys if key not in following])
        if self.hindsight:
            reward, terminated = self._retell(self.hindsight, ring, rows, left, window, reward, terminated)
        over = terminated.cumsum(-1) - terminated.long()
        counted = (offsets <= left.unsqueeze(-1)) & (over == 0)
        steps = counted.sum(-1, keepdim=True)
        last = window.gather(-1, steps - 1)
        rows = ring.at(last.squeeze(-1), following) | rows
        rows[self.reward_key] = (reward * counted * self.gamma**offsets).sum(-1, keepdim=True)
        rows[self.terminated_key] = terminated.gather(-1, steps - 1)
        rows[self.done_key] = rows[self.done_key] | rows[self.terminated_key]
        rows["steps_to_next_obs"] = steps
        return rows

    def _retell(
        self,
        hindsight: Hindsight,
        ring: TransitionBuffer,
        rows: dict[Any, Tensor],
        left: Int[Tensor, " B"],
        window: Int[Tensor, "B n"],
        reward: Tensor,
        terminated: Bool[Tensor, "B n"],
    ) -> tuple[Tensor, Tensor]:
        """Rewards and ends (B, n) for other goals, which are written into the rows."""
        achieved, start = after(hindsight.achieved_key), window[:, 0]
        anew = torch.rand(len(start), 1, device=start.device) < hindsight.k / (hindsight.k + 1)
        # The product may be rounded up to left + 1.
        later = (torch.rand(len(start), device=start.device) * (left + 1)).long().minimum(left)
        reached = ring.at(start + later, [achieved])[achieved]
        goal = torch.where(anew, reached, rows[hindsight.desired_key])
        rows[hindsight.desired_key] = rows[after(hindsight.desired_key)] = goal
        pair = ring.at(window, [achieved])[achieved], goal.unsqueeze(1).expand(-1, window.shape[-1], -1)
        reward = torch.where(anew, hindsight.reward(*pair).to(reward), reward)
        if hindsight.terminated is not None:
            terminated = torch.where(anew, hindsight.terminated(*pair), terminated)
        return reward, terminated


def steps_left(done: Bool[Tensor, "*n T"], mask: Bool[Tensor, "*n T"]) -> Int[Tensor, "*n T"]:
    """Steps that follow each one in its episode; an episode ends where it is done, before padding and with its row."""
    steps = done.shape[-1]
    step = torch.arange(steps, device=done.device)
    ends = done | ~mask.roll(-1, -1)
    ends[..., -1] = True
    # The nearest end at or after each step: a running minimum from behind.
    end = torch.where(ends, step, steps).flip(-1).cummin(-1).values.flip(-1)
    return end - step


def leads_elsewhere(
    achieved: Float[Tensor, "*n T G"], left: Int[Tensor, "*n T"], reward: Callable[[Tensor, Tensor], Tensor]
) -> Bool[Tensor, "*n T"]:
    """Check, with each step's achieved goal as the desired one, whether the episode's end earns less than the step.

    Args:
        achieved: after each step.
        left: of :func:`steps_left`.
        reward: achieved and desired goals -> rewards.
    """
    end = torch.arange(left.shape[-1], device=left.device) + left
    last = achieved.gather(-2, end.unsqueeze(-1).expand_as(achieved))
    return reward(last, achieved).reshape(left.shape) < reward(achieved, achieved).reshape(left.shape)
