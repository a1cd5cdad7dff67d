"""The control law of a hobby servo, in the place of a ``position`` actuator: dead band, duty limit, supply, back-EMF.

    e' = e - max(-w, min(e, w)),   e = goal - q              the controller sees no error within its dead band
    d  = max(-F, min(kp e' - kv v, F))                       the torque that its duty asks for, as at a firm supply
    f  = d V/V0 - b v                                        a motor under the voltage duty V: Lynch and Park, ch. 8.9
    V/V0 = 1 - s d f                                         a supply that sags

kp and kv are the actuator's own. In volts d = (k/R) duty V0 and b = k^2/R, k the torque constant behind the gears, R
the resistance, so that F is the stall torque at the largest duty and F/b the no-load speed. A bridge draws duty times
the motor's current f/k from the supply, and gives it back while it brakes: V = V0 - R_s duty f/k, s = R_s R/(k V0)^2.
Both equations together have one solution,

    f = (d - b v) / (1 + s d^2).

The back-EMF stands behind the limit, where MuJoCo's ``kv`` and the effect ``back_emf`` stand before it: a servo at full
duty slows down with speed. While the actuator is off its leads are open, and f = 0.
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
from onlinebayes.simulators.effects.bounds import non_negative
from onlinebayes.simulators.effects.scales import Scales
from onlinebayes.simulators.effects.seen import Seen, limited
from onlinebayes.simulators.standalone.motors import HobbyServo

DEAD_BAND = 0.1
"""The widest dead band that is tried, in parts of the largest goal."""
NEAR = 0.99
"""A limit that cuts nothing, beside which the other parameters begin: bounds leave room above the largest force."""


@dataclass(frozen=True)
class ServoLaw(Effect):
    """The law of a hobby servo on an actuator of a slide or hinge joint, within the limits that the model has.

    Forces are the actuator's own, before its gear; speed and position are the joint's.

    Args:
        target: actuator; without a position gain (a motor) it has no dead band.
        limit: bounds of F >= 0 [N, N m]; at the upper one the duty is not limited.
        back_emf: bounds of b >= 0 [N s/m, N m s/rad].
        dead_band: bounds of w >= 0, half of the whole band [m, rad].
        sag: bounds of s >= 0 [1/N2, 1/(N m)2].
    """

    target: str
    limit: Parameter
    back_emf: Parameter
    dead_band: Parameter
    sag: Parameter
    name = "servo_law"
    target_kind = "actuator"
    needs_servo = True
    tried_at_servos = True
    contains = ("actuator_saturation", "back_emf")

    def __post_init__(self) -> None:
        for name, bounds in self.parameters.items():
            non_negative(self.key, name, bounds)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """F from a fiftieth to all of the largest force, b and s up to what takes or halves it, w by the goals."""
        return cls(
            target,
            Parameter(0.02 * scales.output, scales.output, ""),
            Parameter(0.0, scales.output / scales.speed, ""),
            Parameter(0.0, DEAD_BAND * scales.force, ""),
            Parameter(0.0, scales.output**-2, ""),
        )

    @property
    def parameters(self) -> ParameterSpace:
        """``limit``, ``back_emf``, ``dead_band`` and ``sag``."""
        return ParameterSpace(
            {"limit": self.limit, "back_emf": self.back_emf, "dead_band": self.dead_band, "sag": self.sag}
        )

    @property
    def neutral(self) -> Mapping[str, float]:
        """F at its upper bound, which is no limit; b = w = s = 0."""
        return {"limit": self.limit.high, "back_emf": 0.0, "dead_band": 0.0, "sag": 0.0}

    def standalone(self, values: Mapping[str, float]) -> HobbyServo:
        """See :class:`.HobbyServo`."""
        limit = values["limit"] if values["limit"] < self.limit.high else math.inf
        return HobbyServo(limit, values["back_emf"], values["dead_band"], values["sag"])

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """Limits that cut more and more, with the back-EMF that they bring; a dead band and a sag by themselves."""
        cut = tuple(self._start(part, back_emf=0.1) for part in (0.65, 0.4, 0.2))
        return (*cut, self._start(NEAR, dead_band=0.2), self._start(NEAR, sag=0.3))

    def force(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """f less the force that the actuator has in the model [N, N m at the transmission]."""
        servo, v = seen.servo, seen.v
        assert servo is not None
        half = parameters["dead_band"] * servo.stiffness
        pull = servo.force + servo.damping * v  # kp e
        asked = limited(servo.force - torch.minimum(torch.maximum(pull, -half), half), servo.low, servo.high)
        most = torch.where(parameters["limit"] < self.limit.high, parameters["limit"], torch.inf)
        asked = limited(asked, -most, most)
        works = servo.low < servo.high
        torque = (asked - parameters["back_emf"] * v) / (1.0 + parameters["sag"] * asked.square())
        return torch.where(works, torque, torch.zeros_like(torque)) - limited(servo.force, servo.low, servo.high)

    def _start(self, limit: float, **parts: float) -> dict[str, float]:
        """Each at this part of the way from its lower bound to its upper one; what is not named is neutral."""
        return {**self.neutral, **{name: self._part(name, part) for name, part in {"limit": limit, **parts}.items()}}

    def _part(self, name: str, part: float) -> float:
        bounds = self.parameters[name]
        return bounds.low + part * (bounds.high - bounds.low)
