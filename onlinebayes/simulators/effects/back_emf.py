"""Back-EMF of an actuator: f -> f - k v, v the actuator's velocity.

A motor under a voltage loses torque with speed. v is the joint's velocity times the gear, and f acts through the gear
too: on a joint it is viscous friction of size gear^2 k, until a limit of force comes in reach. For a servo it adds to
kv; behind the limit of its duty it is in :mod:`.servo_law`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.bounds import non_negative
from onlinebayes.simulators.effects.scales import Scales


@dataclass(frozen=True)
class BackEmf(Effect):
    """-k v on an actuator's own force, within its limits.

    A torch system's actuators do not know their velocity: it has no form there.

    Args:
        target: actuator.
        constant: bounds of k >= 0 [N s/m, N m s/rad].
    """

    target: str
    constant: Parameter
    name = "back_emf"
    target_kind = "actuator"

    def __post_init__(self) -> None:
        non_negative(self.key, "constant", self.constant)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """k up to the value that takes the largest force away at the largest speed."""
        return cls(target, Parameter(0.0, scales.output / scales.speed, ""))

    @property
    def parameters(self) -> ParameterSpace:
        """``constant``."""
        return ParameterSpace({"constant": self.constant})

    @property
    def neutral(self) -> Mapping[str, float]:
        """k = 0."""
        return {"constant": 0.0}
