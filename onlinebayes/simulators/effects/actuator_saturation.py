"""A limit of an actuator's force: f -> max(-F, min(f, F)).

f is the actuator's own force, before the gear. "No limit" is a value of F like any other, the upper bound
of the parameter: there, and only there, nothing is written. Take that bound no smaller than the largest force that
occurs, and the effect is continuous up to it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.bounds import non_negative, starts_within
from onlinebayes.simulators.effects.scales import Scales


@dataclass(frozen=True)
class ActuatorSaturation(Effect):
    """abs(f) <= F on an actuator, within the limits that the model has.

    On torch systems, whose actuators are pure forces, effects act on the command in their order: add this one last.

    Args:
        target: actuator.
        limit: bounds of F >= 0 [N, N m]; at the upper one the force is not limited.
    """

    target: str
    limit: Parameter
    name = "actuator_saturation"
    target_kind = "actuator"
    has_command = True

    def __post_init__(self) -> None:
        non_negative(self.key, "limit", self.limit)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """F from a fiftieth of the largest force to that force."""
        return cls(target, Parameter(0.02 * scales.output, scales.output, ""))

    @property
    def parameters(self) -> ParameterSpace:
        """``limit``."""
        return ParameterSpace({"limit": self.limit})

    @property
    def neutral(self) -> Mapping[str, float]:
        """F at its upper bound: no limit."""
        return {"limit": self.limit.high}

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """Limits that cut more and more: a limit just below the largest force is seen at its peaks alone."""
        return starts_within("limit", self.limit, (0.8, 0.65, 0.5, 0.25))

    def command(
        self,
        parameters: Mapping[str, Tensor],
        state: TensorDict | None,
        command: Float[Tensor, "N K"],
        timestep: float,
    ) -> tuple[Float[Tensor, "N K"], TensorDict | None]:
        """u cut to [-F, F], for a backend whose actuators are pure forces."""
        limit = parameters["limit"][:, None]
        cut = torch.minimum(torch.maximum(command, -limit), limit)
        return torch.where(limit < self.limit.high, cut, command), state
