"""A dead zone of an actuator: 0 for abs(u) < w, else u - w sign(u).

It acts on the command: for a servo, on the goal; a dead band of its error is in :mod:`.servo_law`. Plain MuJoCo has no
term for it.
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
from onlinebayes.simulators.standalone.commands import DeadZone


@dataclass(frozen=True)
class ActuatorDeadZone(Effect):
    """Commands below a width w do nothing, larger ones lose it.

    Args:
        target: actuator.
        width: bounds of w >= 0, half of the whole zone [command units].
    """

    target: str
    width: Parameter
    name = "actuator_dead_zone"
    target_kind = "actuator"
    has_command = True

    def __post_init__(self) -> None:
        non_negative(self.key, "width", self.width)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """w up to half of the largest command."""
        return cls(target, Parameter(0.0, 0.5 * scales.force, ""))

    @property
    def parameters(self) -> ParameterSpace:
        """``width``."""
        return ParameterSpace({"width": self.width})

    @property
    def neutral(self) -> Mapping[str, float]:
        """w = 0."""
        return {"width": 0.0}

    def standalone(self, values: Mapping[str, float]) -> DeadZone:
        """See :class:`.DeadZone`."""
        return DeadZone(values["width"])

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """A tenth and two fifths of the widest: which commands it swallows depends on w."""
        return starts_within("width", self.width, (0.1, 0.4))

    def command(
        self,
        parameters: Mapping[str, Tensor],
        state: TensorDict | None,
        command: Float[Tensor, "N K"],
        timestep: float,
    ) -> tuple[Float[Tensor, "N K"], TensorDict | None]:
        """u less its part within [-w, w]."""
        w = parameters["width"][:, None]
        return torch.where(w > 0, command - torch.minimum(torch.maximum(command, -w), w), command), state
