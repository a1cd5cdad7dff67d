"""A hardening spring at a joint: tau = -k3 (q - q0)^3."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from jaxtyping import Float
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.bounds import joint_unit, non_negative
from onlinebayes.simulators.effects.scales import Scales
from onlinebayes.simulators.effects.seen import Seen


@dataclass(frozen=True)
class CubicStiffness(Effect):
    """-k3 (q - q0)^3 on a slide or hinge joint, beside the spring that the model has.

    Args:
        target: joint.
        stiffness3: bounds of k3 >= 0 [N/m3, N m/rad3].
        springref: bounds of the rest position q0 [m, rad].
    """

    target: str
    stiffness3: Parameter
    springref: Parameter
    name = "cubic_stiffness"
    target_kind = "joint"
    needs_position = True

    def __post_init__(self) -> None:
        non_negative(self.key, "stiffness3", self.stiffness3)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """k3 up to what pulls with the largest force at half the travel; q0 within half a travel of the middle."""
        half = scales.travel / 2
        return cls(
            target,
            Parameter(0.0, scales.force / half**3, joint_unit(scales.unit, "N/m3", "N m/rad3")),
            Parameter(scales.centre - half, scales.centre + half, joint_unit(scales.unit, "m", "rad")),
        )

    @property
    def parameters(self) -> ParameterSpace:
        """``stiffness3`` and ``springref``."""
        return ParameterSpace({"stiffness3": self.stiffness3, "springref": self.springref})

    @property
    def neutral(self) -> Mapping[str, float]:
        """k3 = 0; q0, without meaning then, is the middle of its bounds."""
        return {"stiffness3": 0.0, "springref": (self.springref.low + self.springref.high) / 2}

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """A weak spring with its rest position on either side: at k3 = 0 nothing depends on q0."""
        low, high = self.springref.low, self.springref.high
        k = self.stiffness3.low + 0.1 * (self.stiffness3.high - self.stiffness3.low)
        return tuple({"stiffness3": k, "springref": low + part * (high - low)} for part in (0.25, 0.75))

    def force(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """-k3 (q - q0)^3 [N, N m]."""
        x = seen.q - parameters["springref"]
        return -parameters["stiffness3"] * x * x * x
