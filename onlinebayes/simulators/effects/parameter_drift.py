"""A parameter that changes steadily in time: theta(t) = theta + r (t - t0).

t is the measurements' own clock: where all runs share one, the drift goes through the whole log; where each run begins
at zero, through each run anew. t0 is the middle of what was measured, so that theta is the value there. No simulator
carries it: criticism replays each piece of a window with the value at its middle, cut off at the parameter's bounds.
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


@dataclass(frozen=True)
class ParameterDrift(Effect):
    """A free parameter that drifts.

    Args:
        target: the parameter's address.
        rate: bounds of r [its unit per second].
        middle: t0 [s].
    """

    target: str
    rate: Parameter
    middle: float = 0.0
    name = "parameter_drift"
    target_kind = "parameter"
    tried_last = True

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """r up to what takes the parameter from one bound to the other, either way."""
        bounds, (begin, end) = scales.bounds, scales.span
        largest = (bounds.high - bounds.low) / (end - begin)
        return cls(target, Parameter(-largest, largest, f"{bounds.unit or '1'}/s"), (begin + end) / 2)

    @property
    def parameters(self) -> ParameterSpace:
        """``rate``."""
        return ParameterSpace({"rate": self.rate})

    @property
    def neutral(self) -> Mapping[str, float]:
        """r = 0."""
        return {"rate": 0.0}

    def standalone(self, values: Mapping[str, float]) -> str:
        """None: a model that is stepped on has no time of the log."""
        return "which is a change along the time of the log: the model files hold the value without it"

    def shift(
        self, parameters: Mapping[str, Tensor], begin: Float[Tensor, " W"], end: Float[Tensor, " W"]
    ) -> Float[Tensor, "*batch W"]:
        """r (t - t0) at the middle of the interval."""
        return parameters["rate"] * ((begin + end) / 2 - self.middle)
