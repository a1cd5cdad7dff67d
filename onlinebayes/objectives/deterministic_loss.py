"""The losses of a deterministic actor and its critic, without bookkeeping.

    target     y = clip(R + gamma^m (1 - terminated) Q'(s_m, pi'(s_m)), low, high)        R the return of m steps
    critic     mean (Q(s, a) - y)^2
    actor      mean (- Q(s, pi(s)) + c mean_j pi_j(s)^2),    pi in units of the bounds, -1 .. 1

Lillicrap et al., Continuous Control with Deep Reinforcement Learning (2016); the clip and the penalty c are from
Andrychowicz et al., Hindsight Experience Replay (2017). Where rewards are -1 or 0, no return lies outside
-1 / (1 - gamma) .. 0. Without clip and penalty the same numbers as TorchRL's ``DDPGLoss`` (tests compare loss and
gradients).
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from tensordict import NestedKey, TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor, nn

from onlinebayes.objectives.inputs import Inputs, after


class DeterministicLoss(TensorDictModuleBase):
    """Transitions -> the two losses.

    ``in_keys`` are the observed keys, ``"action"``, ``("next", "reward")``, ``("next", "terminated")`` and the observed
    keys under ``"next"``; ``"steps_to_next_obs"`` is m where it is there, else m = 1. ``out_keys`` are
    ``"loss_actor"``, ``"loss_value"``, ``"pred_value"`` and ``"target_value"``, the last two as means over the batch.

    Args:
        inputs: the observed keys.
        actor: row (B, F) -> action (B, A) in units of its bounds, -1 .. 1.
        critic: row and action in such units (B, F + A) -> (B, 1).
        targets: actor and critic again, following.
        low, high: the action's bounds (A,).
        gamma: discount factor.
        value_range: bounds of the target; none without it.
        action_penalty: c.
        action_key, reward_key, terminated_key, steps_key: of what their names say.
    """

    def __init__(
        self,
        inputs: Inputs,
        actor: nn.Module,
        critic: nn.Module,
        targets: nn.ModuleList,
        low: Float[Tensor, " A"],
        high: Float[Tensor, " A"],
        *,
        gamma: float,
        value_range: tuple[float, float] | None = None,
        action_penalty: float = 0.0,
        action_key: NestedKey = "action",
        reward_key: NestedKey = "reward",
        terminated_key: NestedKey = "terminated",
        steps_key: NestedKey = "steps_to_next_obs",
    ) -> None:
        super().__init__()
        self.inputs, self.actor, self.critic, self.targets = inputs, actor, critic, targets
        self.gamma, self.value_range, self.action_penalty = gamma, value_range, action_penalty
        self.action_key, self.steps_key = action_key, steps_key
        self.reward_key, self.terminated_key = after(reward_key), after(terminated_key)
        self.register_buffer("_centre", (high + low) / 2, persistent=False)
        self.register_buffer("_half", (high - low) / 2, persistent=False)
        following = [after(key) for key in inputs.keys]
        self.in_keys = [*inputs.keys, action_key, self.reward_key, self.terminated_key, *following]
        self.out_keys = ["loss_actor", "loss_value", "pred_value", "target_value"]

    def losses(
        self,
        row: Float[Tensor, "B F"],
        action: Float[Tensor, "B A"],
        reward: Float[Tensor, "B 1"],
        terminated: Tensor,
        following: Float[Tensor, "B F"],
        steps: Tensor | None = None,
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Losses of actor and critic, mean value and mean target (both detached), of plain tensors."""
        with torch.no_grad():
            actor, critic = self.targets
            discount = self.gamma if steps is None else self.gamma**steps
            target = reward + discount * (~terminated) * critic(torch.cat([following, actor(following)], -1))
            if self.value_range is not None:
                target = target.clamp(*self.value_range)
        value = self.critic(torch.cat([row, (action - self._centre) / self._half], -1))
        loss_value = (value - target).square().mean()
        unit = self.actor(row)
        # The actor's loss asks for no gradient of the critic's weights, a third of the backward pass.
        self.critic.requires_grad_(False)
        loss_actor = -self.critic(torch.cat([row, unit], -1)).mean()
        self.critic.requires_grad_(True)
        if self.action_penalty:
            loss_actor = loss_actor + self.action_penalty * unit.square().mean()
        return loss_actor, loss_value, value.detach().mean(), target.mean()

    def forward(self, tensordict: TensorDictBase) -> TensorDict:
        """The losses as scalars."""
        row = self.inputs.read(tensordict)
        values = self.losses(
            row,
            tensordict.get(self.action_key).to(row),
            tensordict.get(self.reward_key).to(row),
            tensordict.get(self.terminated_key),
            self.inputs.read(tensordict, ("next",)),
            tensordict.get(self.steps_key, None),
        )
        return TensorDict(dict(zip(self.out_keys, values, strict=True)))
