"""A parameter that changes once: theta(t) = theta + s for t > t1, theta before.

t is the measurements' own clock, as for a :mod:`.parameter_drift`. No simulator carries it: criticism replays each
piece of a window with the mean over it, cut off at the parameter's bounds. A fit that begins more than a window away
does not find it, therefore screening starts at many instants.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from jaxtyping import Float
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.scales import Scales

MOST_INSTANTS = 63


@dataclass(frozen=True)
class ParameterStep(Effect):
    """A free parameter that changes once.

    Args:
        target: the parameter's address.
        size: bounds of s [its unit].
        time: bounds of t1 [s].
        instants: at which screening starts.
    """

    target: str
    size: Parameter
    time: Parameter
    instants: int = 7
    name = "parameter_step"
    target_kind = "parameter"
    tried_last = True

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """s up to the distance between the parameter's bounds, either way, at any time that was measured."""
        bounds, (begin, end) = scales.bounds, scales.span
        largest = bounds.high - bounds.low
        # Ten of the longest dead times are a window.
        instants = min(max(round((end - begin) / (10 * scales.time)), 7), MOST_INSTANTS)
        return cls(target, Parameter(-largest, largest, bounds.unit), Parameter(begin, end, "s"), instants)

    @property
    def parameters(self) -> ParameterSpace:
        """``size`` and ``time``."""
        return ParameterSpace({"size": self.size, "time": self.time})

    @property
    def neutral(self) -> Mapping[str, float]:
        """s = 0; t1, without meaning then, is the middle of its bounds."""
        return {"size": 0.0, "time": self._time(0.5)}

    def standalone(self, values: Mapping[str, float]) -> str:
        """None: a model that is stepped on has no time of the log."""
        return "which is a change along the time of the log: the model files hold the value without it"

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """A small step at evenly spaced instants: what it does is not linear in when."""
        parts = ((k + 0.5) / self.instants for k in range(self.instants))
        return tuple({"size": 0.005 * self.size.high, "time": self._time(part)} for part in parts)

    def shift(
        self, parameters: Mapping[str, Tensor], begin: Float[Tensor, " W"], end: Float[Tensor, " W"]
    ) -> Float[Tensor, "*batch W"]:
        """s times the share of the interval that lies behind t1."""
        return parameters["size"] * ((end - parameters["time"]) / (end - begin)).clamp(0.0, 1.0)

    def _time(self, part: float) -> float:
        return self.time.low + part * (self.time.high - self.time.low)
