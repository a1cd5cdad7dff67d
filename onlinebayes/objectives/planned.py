"""A planner in the place of a policy that learns: it is told the belief, and there is nothing to learn.

    line 13 of Algorithm 1, for model-predictive control:    the planner's worlds := the belief

So a run with a planner collects no batches: ``Schedule(steps, policy_batches=0, ...)``.
"""

from __future__ import annotations

from typing import Any, final

from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase

from onlinebayes.objectives.base import TakesBelief
from onlinebayes.runs import BadInput
from onlinebayes.transforms import Distribution


@final
class Planned:
    """The objective of a planner.

    Args:
        planner: ``"observation"`` -> ``"action"``, with ``set_belief``; such as ``onlinebayes.control.MPPI``. All that
            decides its next action stands in its ``state_dict``.

    Raises:
        BadInput: a planner that cannot be told a belief.
    """

    def __init__(self, planner: TensorDictModuleBase) -> None:
        if not isinstance(planner, TakesBelief):
            raise BadInput(f"{type(planner).__name__} has no set_belief", "give a planner, or an objective that learns")
        self.policy: TensorDictModuleBase = planner
        self._told: TakesBelief = planner

    def set_belief(self, belief: Distribution, /) -> None:
        """Plan for the worlds of this belief from now on."""
        self._told.set_belief(belief)

    def update(self, data: TensorDictBase) -> dict[str, float]:
        """Refused: whoever collects batches for a planner plans in every world of them, for nothing.

        Raises:
            BadInput: always.
        """
        raise BadInput("a planner learns nothing from batches", "give the schedule policy_batches=0")

    def state_dict(self) -> dict[str, Any]:
        """Of the planner."""
        return {"planner": dict(self.policy.state_dict())}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from what :meth:`state_dict` gave."""
        self.policy.load_state_dict(state["planner"])
