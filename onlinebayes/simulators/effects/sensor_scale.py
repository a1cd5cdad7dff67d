"""A sensor with a wrong gain: it reads (1 + s) q. The motion is as it was."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from jaxtyping import Float
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.scales import Scales
from onlinebayes.simulators.effects.seen import Reading
from onlinebayes.simulators.standalone.sensors import Gain


@dataclass(frozen=True)
class SensorScale(Effect):
    """(1 + s) q on a signal.

    Args:
        target: signal, e.g. ``"qpos.hinge"``.
        scale: bounds of s > -1 [1].
    """

    target: str
    scale: Parameter
    name = "sensor_scale"
    target_kind = "signal"

    def __post_init__(self) -> None:
        if self.scale.low <= -1:
            raise BadInput(f"{self.key}.scale may be {self.scale.low:g}", "at -1 the sensor is dead: stay above it")

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """From two thirds to one and a half times the true value."""
        return cls(target, Parameter(-1 / 3, 0.5, ""))

    @property
    def parameters(self) -> ParameterSpace:
        """``scale``."""
        return ParameterSpace({"scale": self.scale})

    @property
    def neutral(self) -> Mapping[str, float]:
        """s = 0."""
        return {"scale": 0.0}

    def standalone(self, values: Mapping[str, float]) -> Gain:
        """See :class:`.Gain`."""
        return Gain(values["scale"])

    def sense(self, parameters: Mapping[str, Tensor], reading: Reading) -> Float[Tensor, "*batch T"]:
        """(1 + s) q."""
        return reading.value * (1.0 + parameters["scale"][..., None])

    def unsense(
        self, parameters: Mapping[str, Tensor], q: Float[Tensor, "*batch"], v: Float[Tensor, "*batch"]
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"]]:
        """q / (1 + s), v / (1 + s)."""
        gain = 1.0 + parameters["scale"]
        return q / gain, v / gain
