"""Laws of a sensor: a zero error, a wrong gain, a dead time; see the effects of these names."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from onlinebayes.simulators.standalone.law import Law


@dataclass
class Bias(Law):
    """q + b [the signal's unit]."""

    bias: float

    def sense(self, time: float, value: float, start: float, slope: float) -> float:
        """q + b."""
        return value + self.bias


@dataclass
class Gain(Law):
    """(1 + s) q."""

    scale: float

    def sense(self, time: float, value: float, start: float, slope: float) -> float:
        """(1 + s) q."""
        return value * (1.0 + self.scale)


@dataclass
class Late(Law):
    """q(t - T), T in seconds: linear between timesteps, along the slope before the start."""

    delay: float

    def reset(self, timestep: float) -> None:
        """Nothing was read yet."""
        self.read: list[tuple[float, float]] = []

    def sense(self, time: float, value: float, start: float, slope: float) -> float:
        """q(t - T)."""
        if time > 0:
            self.read.append((time, value))
        then = time - self.delay
        if self.delay <= 0:
            return value
        if then < 0:
            return start + slope * then
        while len(self.read) > 2 and self.read[1][0] <= then:
            self.read.pop(0)
        line = self.read if self.read[0][0] <= then else [(0.0, start), *self.read]
        return float(np.interp(then, [at for at, _ in line], [value for _, value in line]))
