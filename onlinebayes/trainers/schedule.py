"""In which order policy and posterior learn: in turns, one after the other, or the policy alone.

| order               | what happens                                                                            |
|---------------------|-----------------------------------------------------------------------------------------|
| ``online``          | each step: the policy learns in worlds of the belief, then the belief learns (Algorithm 1) |
| ``posterior-first`` | all inference under the untrained policy, then all policy steps in worlds of the belief |
| ``policy-only``     | policy steps only: a baseline in worlds of the prior, or of the truth (an oracle)       |
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from onlinebayes.runs import BadInput

Order = Literal["online", "posterior-first", "policy-only"]


@dataclass(frozen=True)
class Turn:
    """One outer step.

    Attributes:
        policy_batches: collector batches that the policy learns from.
        infers: whether a trajectory is measured and the belief learns.
    """

    policy_batches: int
    infers: bool


@dataclass(frozen=True)
class Schedule:
    """Amount of work in each step, and its order.

    Args:
        steps: outer steps with policy batches; as many real trajectories unless the policy learns alone.
        policy_batches: collector batches that the policy learns from in an outer step.
        real_steps: length of a real trajectory.
        order: see the module.
        behaviours: how many of the policies so far make the simulations of a fit.
        group: most trajectories of one theta in a held-out group.
        first_batches: ``policy_batches`` of the first outer step in which the policy learns; 0 lets an untrained policy
            move the real system before anything is learnt.

    Raises:
        BadInput: a number below 1 (batches below 0), or an unknown order.
    """

    steps: int = 6
    policy_batches: int = 12
    real_steps: int = 50
    order: Order = "online"
    behaviours: int = 3
    group: int = 8
    first_batches: int | None = None

    def __post_init__(self) -> None:
        batches = min(self.policy_batches, self.first_batches or 0)
        if min(self.steps, self.real_steps, self.behaviours, self.group) < 1 or batches < 0:
            raise BadInput(f"{self}", "every number must be at least 1, batches at least 0")
        if self.order not in ("online", "posterior-first", "policy-only"):
            raise BadInput(f"order = '{self.order}'", "use online, posterior-first or policy-only")

    @property
    def turns(self) -> tuple[Turn, ...]:
        """The outer steps in order."""
        first = self.policy_batches if self.first_batches is None else self.first_batches
        online = self.order == "online"
        learn = tuple(Turn(batches, online) for batches in (first, *(self.policy_batches,) * (self.steps - 1)))
        return (Turn(0, True),) * self.steps + learn if self.order == "posterior-first" else learn


def spread(number: int, most: int) -> list[int]:
    """Indices of at most ``most`` of ``number`` things in order, evenly spread, the last one always among them."""
    if number <= most:
        return list(range(number))
    if most == 1:
        return [number - 1]
    return [round(i * (number - 1) / (most - 1)) for i in range(most)]
