"""A sensor with a dead time: it reads q(t - T). The motion is as it was.

Between instants q is interpolated linearly; before the trajectory's start it goes back along the start's velocity,
q(t) = q0 + v0 t for t < 0 (a signal whose slope the state does not tell is held). A state behind a reading (q, v) is
(q + v T, v): both are exact for steady motion and wrong by a T^2 / 2 under an acceleration a.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.bounds import non_negative, starts_within
from onlinebayes.simulators.effects.scales import Scales
from onlinebayes.simulators.effects.seen import Reading
from onlinebayes.simulators.standalone.sensors import Late


@dataclass(frozen=True)
class SensorDelay(Effect):
    """q(t - T) on a signal.

    Args:
        target: signal, e.g. ``"qpos.hinge"``.
        delay: bounds of T >= 0 [s].
    """

    target: str
    delay: Parameter
    name = "sensor_delay"
    target_kind = "signal"

    def __post_init__(self) -> None:
        non_negative(self.key, "delay", self.delay)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """T up to the longest plausible dead time."""
        return cls(target, Parameter(0.0, scales.time, "s"))

    @property
    def parameters(self) -> ParameterSpace:
        """``delay``."""
        return ParameterSpace({"delay": self.delay})

    @property
    def neutral(self) -> Mapping[str, float]:
        """T = 0."""
        return {"delay": 0.0}

    def standalone(self, values: Mapping[str, float]) -> Late:
        """See :class:`.Late`."""
        return Late(values["delay"])

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """A tenth and two fifths of the longest dead time."""
        return starts_within("delay", self.delay, (0.1, 0.4))

    def sense(self, parameters: Mapping[str, Tensor], reading: Reading) -> Float[Tensor, "*batch T"]:
        """q(t - T)."""
        delay = parameters["delay"][..., None]
        return torch.where(delay > 0, reading.at(reading.times - delay), reading.value)

    def unsense(
        self, parameters: Mapping[str, Tensor], q: Float[Tensor, "*batch"], v: Float[Tensor, "*batch"]
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"]]:
        """q + v T, v."""
        return q + v * parameters["delay"], v
