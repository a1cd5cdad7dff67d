"""Cogging of a motor: A sin(n q + phase), the pull of the magnets on the iron as the rotor turns.

On a linear motor n is in periods of 2 pi a metre. Less than a period over the travel is a spring or a load for all that
the data tell (see criticism), so that the bounds of n start there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.bounds import joint_unit, non_negative
from onlinebayes.simulators.effects.scales import Scales
from onlinebayes.simulators.effects.seen import Seen
from onlinebayes.simulators.standalone.frictions import Waves

PERIODS = (1.0, 16.0)
"""Periods over the travel that ``scaled`` allows."""
SPACING = 0.4
"""Of a period over the travel: the widest spacing of starting values that misses none (three values missed 2.6)."""


@dataclass(frozen=True)
class Cogging(Effect):
    """A sin(n q + phase) on a slide or hinge joint.

    Args:
        target: joint.
        amplitude: bounds of A >= 0 [N, N m].
        poles: bounds of n > 0, periods a turn of a hinge; need not be whole [rad/m, 1].
        phase: bounds of the phase [rad].
    """

    target: str
    amplitude: Parameter
    poles: Parameter
    phase: Parameter
    name = "cogging"
    tried_last = True
    target_kind = "joint"
    needs_position = True

    def __post_init__(self) -> None:
        non_negative(self.key, "amplitude", self.amplitude)
        non_negative(self.key, "poles", self.poles)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """A up to the largest force in play, n from one to sixteen periods over the travel, any phase."""
        low, high = (2 * math.pi * periods / scales.travel for periods in PERIODS)
        return cls(
            target,
            Parameter(0.0, scales.force, joint_unit(scales.unit, "N", "N m")),
            Parameter(low, high, joint_unit(scales.unit, "rad/m", "")),
            Parameter(-math.pi, 2 * math.pi, "rad"),  # a turn and a half: a fit does not run into the seam
        )

    @property
    def parameters(self) -> ParameterSpace:
        """``amplitude``, ``poles`` and ``phase``."""
        return ParameterSpace({"amplitude": self.amplitude, "poles": self.poles, "phase": self.phase})

    @property
    def neutral(self) -> Mapping[str, float]:
        """A = 0; n and the phase, without meaning then, are the middle of their bounds."""
        return {
            "amplitude": 0.0,
            "poles": (self.poles.low + self.poles.high) / 2,
            "phase": (self.phase.low + self.phase.high) / 2,
        }

    def standalone(self, values: Mapping[str, float]) -> Waves:
        """See :class:`.Waves`."""
        return Waves(values["amplitude"], values["poles"], values["phase"])

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """A grid of n, spaced by 0.4 periods over the travel of ``scaled``, and of two phases and their opposites."""
        steps = math.ceil((PERIODS[1] - PERIODS[0]) / SPACING - 1e-9)
        width = self.poles.high - self.poles.low
        size = 0.02 * self.amplitude.high
        first = self.phase.low + (self.phase.high - self.phase.low) / 6
        phases = [first + quarter * math.pi / 2 for quarter in range(4)]
        phases = [phase for phase in phases if phase <= self.phase.high]
        return tuple(
            {"amplitude": size, "poles": self.poles.low + width * k / steps, "phase": phase}
            for k in range(steps + 1)
            for phase in phases
        )

    def force(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """A sin(n q + phase) [N, N m]."""
        return parameters["amplitude"] * torch.sin(parameters["poles"] * seen.q + parameters["phase"])
