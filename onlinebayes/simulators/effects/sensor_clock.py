"""A sensor whose clock drifts against that of the commands: it reads q(t - lag(t)). The motion is as it was.

    lag(t) = offset + rate (t - t0),      state behind a reading (q, v):  v' = v / (1 - rate),  q' = q + v' lag

t is the measurements' own clock and t0 its first instant: where each run begins at zero the clocks are set anew in
each, where all runs share one the drift goes through the whole log. A lag may be negative: of two clocks either may be
the faster one. What is shown of the time after a trajectory's end goes on as the last two rows do, an error of
a lag^2 / 2 under an acceleration a, as at its start (see :mod:`.sensor_delay`).

A simulator knows a trajectory's own time alone. Criticism shifts ``offset`` to each window's start (:meth:`shift`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.scales import Scales
from onlinebayes.simulators.effects.seen import Reading

FASTEST = 0.1
"""The largest rate that is tried [1]: a clock that is a tenth off is none."""


@dataclass(frozen=True)
class SensorClock(Effect):
    """q(t - offset - rate (t - t0)) on a signal.

    Args:
        target: signal, e.g. ``"qpos.hinge"``.
        rate: bounds of what the lag grows by [s/s], within -1 and 1.
        offset: bounds of the lag at t0 [s].
        begin: t0 [s].
    """

    target: str
    rate: Parameter
    offset: Parameter
    begin: float = 0.0
    name = "sensor_clock"
    target_kind = "signal"
    tried_where_lag_grows = True
    contains = ("sensor_delay",)

    def __post_init__(self) -> None:
        if self.rate.low <= -1 or self.rate.high >= 1:
            ends = f"{self.rate.low:g} to {self.rate.high:g}"
            raise BadInput(f"{self.key}.rate may be {ends}", "at 1 the sensor's clock stands: stay within -1 and 1")

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """Either way: the longest plausible dead time as the lag at t0, and as what it grows by until the end."""
        begin, end = scales.span
        fastest = min(scales.time / (end - begin), FASTEST)
        both = (Parameter(-fastest, fastest, "s/s"), Parameter(-scales.time, scales.time, "s"))
        return cls(target, *both, begin)

    @property
    def parameters(self) -> ParameterSpace:
        """``rate`` and ``offset``."""
        return ParameterSpace({"rate": self.rate, "offset": self.offset})

    @property
    def neutral(self) -> Mapping[str, float]:
        """No lag, and none to come."""
        return {"rate": 0.0, "offset": 0.0}

    def standalone(self, values: Mapping[str, float]) -> str:
        """None: a model that is stepped on has no clock of the log."""
        return "which is the drift of the log's clocks: a model that is stepped on has none"

    @property
    def shifted(self) -> str:
        """Its own ``offset``."""
        return f"{self.key}.offset"

    def shift(
        self, parameters: Mapping[str, Tensor], begin: Float[Tensor, " W"], end: Float[Tensor, " W"]
    ) -> Float[Tensor, "*batch W"]:
        """By how much more it lags where the interval begins: rate (t - t0)."""
        return parameters["rate"] * (begin - self.begin)

    def sense(self, parameters: Mapping[str, Tensor], reading: Reading) -> Float[Tensor, "*batch T"]:
        """q(t - lag(t)), with ``offset`` the lag at the trajectory's start."""
        lag = parameters["offset"][..., None] + parameters["rate"][..., None] * reading.times
        return torch.where(lag != 0, reading.at(reading.times - lag), reading.value)

    def unsense(
        self, parameters: Mapping[str, Tensor], q: Float[Tensor, "*batch"], v: Float[Tensor, "*batch"]
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"]]:
        """q + v' lag, v' = v / (1 - rate)."""
        rate = v / (1.0 - parameters["rate"])
        return q + rate * parameters["offset"], rate
