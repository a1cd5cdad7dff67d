"""A sensor with a zero error: it reads q + b. The motion is as it was."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from jaxtyping import Float
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.bounds import joint_unit
from onlinebayes.simulators.effects.scales import Scales
from onlinebayes.simulators.effects.seen import Reading
from onlinebayes.simulators.standalone.sensors import Bias


@dataclass(frozen=True)
class SensorBias(Effect):
    """q + b on a signal.

    Args:
        target: signal, e.g. ``"qpos.hinge"``.
        bias: bounds of b, either sign [the signal's unit].
    """

    target: str
    bias: Parameter
    name = "sensor_bias"
    target_kind = "signal"
    tried_per_run = True  # an encoder finds another zero each time it is switched on

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """b up to a quarter of the travel, either sign."""
        unit = joint_unit(scales.unit, "m", "rad") + ("/s" if target.startswith("qvel.") else "")
        return cls(target, Parameter(-0.25 * scales.travel, 0.25 * scales.travel, unit))

    @property
    def parameters(self) -> ParameterSpace:
        """``bias``."""
        return ParameterSpace({"bias": self.bias})

    @property
    def neutral(self) -> Mapping[str, float]:
        """b = 0."""
        return {"bias": 0.0}

    def standalone(self, values: Mapping[str, float]) -> Bias:
        """See :class:`.Bias`."""
        return Bias(values["bias"])

    def sense(self, parameters: Mapping[str, Tensor], reading: Reading) -> Float[Tensor, "*batch T"]:
        """q + b."""
        return reading.value + parameters["bias"][..., None]

    def unsense(
        self, parameters: Mapping[str, Tensor], q: Float[Tensor, "*batch"], v: Float[Tensor, "*batch"]
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"]]:
        """q - b, v."""
        return q - parameters["bias"], v
