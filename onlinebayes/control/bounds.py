"""Commands that a machine can take: within bounds, and changing no faster than it allows.

    low <= u_t <= high,    |u_t - u_{t-1}| <= rate dt

Both sets are convex: a weighted mean of admissible sequences is admissible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torchrl.data import Bounded, TensorSpec

from onlinebayes.runs import BadInput


@dataclass(frozen=True)
class Bounds:
    """Of each command.

    Args:
        low, high: one for each of U commands [command units].
        rate: greatest change, one for each or one for all [command units / s]; None for any.

    Raises:
        BadInput: bounds that cross or are infinite, a rate that is not positive, another number of them.
    """

    low: Sequence[float]
    high: Sequence[float]
    rate: float | Sequence[float] | None = None

    def __post_init__(self) -> None:
        if len(self.low) != len(self.high) or not len(self.low):
            raise BadInput(f"{len(self.low)} lower and {len(self.high)} upper bounds", "give one of each a command")
        for i, (low, high) in enumerate(zip(self.low, self.high, strict=True)):
            if not -float("inf") < low < high < float("inf"):
                raise BadInput(f"command {i} is bounded by [{low:g}, {high:g}]", "needs finite bounds with low < high")
        rates = () if self.rate is None else (self.rate,) if isinstance(self.rate, float | int) else self.rate
        if any(not rate > 0 for rate in rates):
            raise BadInput(f"commands that change by {self.rate} a second", "a rate is positive, or None for any")
        if len(rates) not in (0, 1, len(self.low)):
            raise BadInput(f"{len(rates)} rates for {len(self.low)} commands", "give one for each, or one for all")

    @classmethod
    def of(cls, spec: TensorSpec, rate: float | Sequence[float] | None = None) -> Bounds:
        """Those of a task's action spec.

        Raises:
            BadInput: it has none, as where actions are discrete.
        """
        if not isinstance(spec, Bounded) or spec.ndim != 1:
            raise BadInput(f"actions of {type(spec).__name__}", "a planner needs bounded commands, one row of them")
        return cls(tuple(spec.space.low.double().tolist()), tuple(spec.space.high.double().tolist()), rate)

    @property
    def number(self) -> int:
        """Of commands U."""
        return len(self.low)

    def admit(
        self, plan: Float[Tensor, "*batch H U"], last: Float[Tensor, "*#batch U"], dt: float
    ) -> Float[Tensor, "*batch H U"]:
        """The plan moved within the bounds, step after step.

        Args:
            plan: commands [command units].
            last: those before the first step.
            dt: between steps [s].
        """
        low, high = (torch.tensor(each).to(plan) for each in (self.low, self.high))
        plan = torch.clamp(plan, low, high)
        if self.rate is None:
            return plan
        change, steps = torch.as_tensor(self.rate).to(plan) * dt, []
        for wanted in plan.unbind(-2):
            last = torch.clamp(wanted, last - change, last + change)
            steps.append(last)
        return torch.stack(steps, dim=-2)
