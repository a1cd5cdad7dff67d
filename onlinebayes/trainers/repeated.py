r"""Simulations that repeat the commands of real trajectories, in the place of asking anew whoever gave them.

    u_t of world i  =  u_t of real trajectory i mod n

A planner would have to plan at every step of every simulated world. Nor is that needed: why a command was given says
nothing of theta beyond what had been seen by then,

    p(theta | y, u)  prop. to  p(theta) prod_t p(y_t+1 | y_1..t, u_1..t, theta) p(u_t | y_1..t, u_1..t-1)

the last factor is the same for every theta. The same holds where nobody knows who gave the commands, as in a log.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, final

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor

from onlinebayes.runs import BadInput

INIT = "is_init"
"""Key under which TorchRL's ``InitTracker`` says that an episode begins."""


@final
class Repeated(TensorDictModuleBase):
    """A policy that gives the commands of trajectories again.

    Args:
        trajectories: batch size (n, T), with ``"action"`` and ``"mask"``; without them there is nothing to repeat until
            a state is loaded. Beyond its last step a trajectory's last command is held.

    Raises:
        BadInput: at a call, an environment that does not tell where episodes begin, or nothing to repeat.
    """

    def __init__(self, trajectories: TensorDictBase | None = None) -> None:
        self.in_keys, self.out_keys = [INIT], ["action"]
        super().__init__()
        self._action, self._last = torch.zeros(0, 0, 0), torch.zeros(0, dtype=torch.long)
        self._step = torch.zeros(0, dtype=torch.long)
        if trajectories is not None:
            self._action = trajectories.get("action").clone()
            self._last = trajectories.get("mask").sum(1).clamp_min(1) - 1

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write the actions."""
        if not len(self._action):
            raise BadInput("there are no commands to repeat", "give the trajectories that they stand in")
        began = tensordict.get(INIT, None)
        if began is None:
            raise BadInput(
                "the environment does not tell where an episode begins",
                "give the problem transforms=lambda: [InitTracker()], of torchrl.envs",
            )
        rows = torch.arange(began.numel(), device=self._action.device)
        action = self._action[rows % len(self._action), self._next(began.reshape(-1).to(rows.device))]
        batch, device = tensordict.batch_size, tensordict.device
        return tensordict.set("action", action.to(device or action.device).reshape(*batch, *action.shape[1:]))

    def _next(self, began: Tensor) -> Tensor:
        """Return the step of its trajectory that each world repeats now."""
        went_on = self._step if len(self._step) == len(began) else torch.zeros_like(began, dtype=torch.long)
        step = torch.where(began, 0, went_on)
        self._step = step + 1
        return torch.minimum(step, self._last[torch.arange(len(began), device=step.device) % len(self._last)])

    def get_extra_state(self) -> dict[str, Any]:
        """The commands; a part of ``state_dict``."""
        return {"action": self._action, "last": self._last}

    def set_extra_state(self, state: Mapping[str, Tensor]) -> None:
        """Repeat these."""
        self._action, self._last = state["action"].clone(), state["last"].clone()
