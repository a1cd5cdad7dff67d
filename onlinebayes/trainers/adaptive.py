r"""A planner that learns while it acts: after every few steps its belief is inferred anew from what it has seen.

    after step k L:   p(theta) = q(theta | y_0 u_0 ... y_kL),    the planner's worlds := p
    every step:       u_t = plan(y_t; p)

The trainer lets a whole episode pass between two beliefs; a robot whose next plan is to know what the last second
told cannot wait as long. The estimator is trained beforehand: :class:`~onlinebayes.inference.Windowed` around one of
sets conditions on the windows so far within a few plans' time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, cast, final

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor

from onlinebayes.objectives import TakesBelief
from onlinebayes.runs import BadInput
from onlinebayes.trainers.repeated import INIT
from onlinebayes.transforms import Distribution


@final
class AdaptivePlanner(TensorDictModuleBase):
    """A policy for one system.

    Args:
        planner: observation -> action, with ``set_belief``; it has a belief to begin with.
        infer: trajectories (1, T) of what was seen -> belief; ``condition`` of a fitted estimator, or of a belief that
            follows a machine which changes.
        every: steps between two beliefs L.
        memory: steps that are looked back on; None for the whole episode.

    Attributes:
        belief: the last one; None before the first.

    Raises:
        BadInput: a planner that cannot be told a belief, numbers below 1; at a call, several systems at once.
    """

    def __init__(
        self,
        planner: TensorDictModuleBase,
        infer: Callable[[TensorDict], Distribution],
        every: int = 10,
        memory: int | None = None,
    ) -> None:
        self.in_keys, self.out_keys = ["observation"], ["action"]
        super().__init__()
        if not isinstance(planner, TakesBelief):
            raise BadInput(f"{type(planner).__name__} has no set_belief", "give a planner")
        if every < 1 or (memory is not None and memory < every):
            raise BadInput(f"a belief every {every} steps from the last {memory}", "needs 1 <= every <= memory")
        self.planner: TensorDictModuleBase = planner
        self._infer, self.every, self.memory = infer, every, memory
        self.belief: Distribution | None = None
        self.reset()

    def reset(self) -> None:
        """Forget what was seen; the belief stays."""
        self._seen, self._done = list[Tensor](), list[Tensor]()

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Infer where it is time, then plan."""
        observation = tensordict.get("observation")
        if tensordict.batch_size.numel() != 1:
            raise BadInput(
                f"{tensordict.batch_size.numel()} systems at once", "one adaptive planner follows one system"
            )
        began = tensordict.get(INIT, None)
        if began is not None and bool(began.any()):
            self.reset()
        self._seen.append(observation.reshape(-1).clone())
        if self._done and len(self._done) % self.every == 0:
            self.belief = self._infer(self.trajectory())
            cast(TakesBelief, self.planner).set_belief(self.belief)
        planned = self.planner(tensordict)
        self._done.append(planned.get("action").reshape(-1).clone())
        return planned

    def trajectory(self) -> TensorDict:
        """Return the episode so far, at most as far back as the memory reaches: batch size (1, T)."""
        last = len(self._seen) - 1  # the command after it has no outcome yet
        first = 0 if self.memory is None else max(0, last - self.memory)
        seen, done = torch.stack(self._seen[first : last + 1])[None], self._done[first:last]
        parts = {"observation": seen[:, :-1], "action": torch.stack(done)[None], "next": {"observation": seen[:, 1:]}}
        mask = torch.ones(1, len(done), dtype=torch.bool, device=seen.device)
        return TensorDict({**parts, "mask": mask}, batch_size=(1, len(done)))

    def get_extra_state(self) -> dict[str, Any]:
        """Return the observations and actions so far; the belief stands in the planner's state."""
        return {"seen": list(self._seen), "done": list(self._done)}

    def set_extra_state(self, state: Mapping[str, Any]) -> None:
        """Go on from there."""
        self._seen, self._done = list(state["seen"]), list(state["done"])
