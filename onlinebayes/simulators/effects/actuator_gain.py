"""An actuator stronger or weaker than modelled: f -> (1 + g) f.

For a motor this is (1 + g) u. For a servo it scales the force, not the goal. Limits of force act after it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.scales import Scales


@dataclass(frozen=True)
class ActuatorGain(Effect):
    """(1 + g) f on an actuator.

    Args:
        target: actuator.
        gain: bounds of g > -1 [1].
    """

    target: str
    gain: Parameter
    name = "actuator_gain"
    target_kind = "actuator"
    same_law_as = ("actuator.*.gear[0]",)
    has_command = True

    def __post_init__(self) -> None:
        if self.gain.low <= -1:
            raise BadInput(f"{self.key}.gain may be {self.gain.low:g}", "at -1 the actuator is dead: stay above it")

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """From a fifth of the force to four times as much."""
        return cls(target, Parameter(-0.8, 3.0, ""))

    @property
    def parameters(self) -> ParameterSpace:
        """``gain``."""
        return ParameterSpace({"gain": self.gain})

    @property
    def neutral(self) -> Mapping[str, float]:
        """g = 0."""
        return {"gain": 0.0}

    def command(
        self,
        parameters: Mapping[str, Tensor],
        state: TensorDict | None,
        command: Float[Tensor, "N K"],
        timestep: float,
    ) -> tuple[Float[Tensor, "N K"], TensorDict | None]:
        """(1 + g) u, for a backend whose actuators are pure forces."""
        return command * (1.0 + parameters["gain"][:, None]), state
