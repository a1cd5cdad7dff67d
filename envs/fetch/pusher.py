"""A policy without learning that pushes the object to its goal: a demonstrator, and a mark beside learnt policies.

    over the object if it is in the way  ->  down behind it  ->  push along the line to the goal

It sees what a policy sees and remembers nothing. With friction 1 it reaches every goal of "push"; "slide" has goals out
of the arm's reach, for which it is no use.
"""

from __future__ import annotations

from typing import final

import torch
from jaxtyping import Float
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor

BEHIND = 0.065
"""From the object's centre to where the gripper comes down [m]."""

ASIDE = 0.012
"""Largest distance of the gripper from the line while it pushes [m]."""

HIGH, LOW = 0.5, 0.425
"""Heights of the gripper above the object and beside it [m]."""

GAIN = 12.0
"""Of the command, in units of 5 cm a metre."""

SLOW, FAST = 0.35, 0.05
"""Distance ahead of the gripper that it is pushed: that share of the way left, and at most so far [m]. A block that
slides easily would else run ahead of the gripper and past the goal."""

CLOSE = 0.01
"""From the goal, where it stops [m]."""


@final
class ScriptedPusher(TensorDictModuleBase):
    """``"observation"``, ``"desired_goal"`` -> ``"action"`` of :class:`~envs.fetch.FetchTask`, task "push"."""

    in_keys = ["observation", "desired_goal"]  # noqa: RUF012
    out_keys = ["action"]  # noqa: RUF012

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write the action."""
        return tensordict.set("action", self.act(tensordict["observation"], tensordict["desired_goal"]))

    def act(
        self, observation: Float[Tensor, "*batch 25"], goal: Float[Tensor, "*batch 3"]
    ) -> Float[Tensor, "*batch 4"]:
        """The action for a row of observations."""
        grip, thing = observation[..., :3], observation[..., 3:6]
        way = (goal - thing)[..., :2]
        left = way.norm(dim=-1, keepdim=True)
        along = way / left.clamp(min=1e-6)
        begin = thing[..., :2] - BEHIND * along
        from_object = grip[..., :2] - thing[..., :2]
        ahead = (from_object * along).sum(-1, keepdim=True)
        off = (from_object - ahead * along).norm(dim=-1, keepdim=True)
        pushing = (off < ASIDE) & (ahead < 0) & (grip[..., 2:] < LOW + 0.02)
        over = (grip[..., :2] - begin).norm(dim=-1, keepdim=True) < ASIDE
        high = grip[..., 2:] > HIGH - 0.03
        # Pushed from where the gripper is on the line, and back onto the line.
        push = along * (SLOW * left).clamp(max=FAST) - (from_object - ahead * along)
        aside = torch.where(high | over, begin - grip[..., :2], torch.zeros_like(begin))
        plane = torch.where(pushing, push, aside)
        height = torch.where(pushing | over, LOW, HIGH) - grip[..., 2:]
        move = GAIN * torch.cat([plane, height, torch.zeros_like(height)], dim=-1)
        return torch.where(left < CLOSE, torch.zeros_like(move), move.clamp(-1, 1))
