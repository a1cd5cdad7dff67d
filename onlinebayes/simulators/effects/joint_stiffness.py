"""A spring at a joint: tau = -k (q - q0)."""

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
class JointStiffness(Effect):
    """-k (q - q0) on a slide or hinge joint; it adds to the spring that the model has.

    Args:
        target: joint.
        stiffness: bounds of k >= 0 [N/m, N m/rad].
        springref: bounds of the rest position q0 [m, rad].
    """

    target: str
    stiffness: Parameter
    springref: Parameter
    name = "joint_stiffness"
    target_kind = "joint"
    same_law_as = ("joint.*.stiffness",)
    needs_position = True

    def __post_init__(self) -> None:
        non_negative(self.key, "stiffness", self.stiffness)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """k up to what pulls with the largest force at half the travel; q0 within one travel of the middle."""
        return cls(
            target,
            Parameter(0.0, 2 * scales.force / scales.travel, joint_unit(scales.unit, "N/m", "N m/rad")),
            Parameter(
                scales.centre - scales.travel, scales.centre + scales.travel, joint_unit(scales.unit, "m", "rad")
            ),
        )

    @property
    def parameters(self) -> ParameterSpace:
        """``stiffness`` and ``springref``."""
        return ParameterSpace({"stiffness": self.stiffness, "springref": self.springref})

    @property
    def neutral(self) -> Mapping[str, float]:
        """k = 0; q0, without meaning then, is the middle of its bounds."""
        return {"stiffness": 0.0, "springref": (self.springref.low + self.springref.high) / 2}

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """A weak spring with its rest position on either side: at k = 0 nothing depends on q0."""
        low, high = self.springref.low, self.springref.high
        k = self.stiffness.low + 0.1 * (self.stiffness.high - self.stiffness.low)
        return tuple({"stiffness": k, "springref": low + part * (high - low)} for part in (0.25, 0.75))

    def force(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """-k (q - q0) [N, N m]."""
        return -parameters["stiffness"] * (seen.q - parameters["springref"])
