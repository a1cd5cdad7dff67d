"""Softness of a geom's contacts: MuJoCo's ``solref``, a damped spring between bodies; neutral at the model's own.

    b = 2 / (d T),   k = d(r) / (d T zeta)^2,   penetration r and its rate v:  a_ref = -b v - k r

T is the time constant with which a penetration decays, zeta its damping ratio, d the impedance (MuJoCo: Computation,
"Solver parameters"). Below zeta = 1 contacts bounce. MuJoCo keeps T at two timesteps or more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.scales import Scales


@dataclass(frozen=True)
class ContactSoftness(Effect):
    """Another compliance of a geom's contacts.

    Args:
        target: geom of a body that moves; or such a body, for all of its geoms.
        time_constant: bounds of T > 0 [s].
        damping_ratio: bounds of zeta > 0 [1].
        own: the model's own T and zeta, at which nothing changes [s, 1].
    """

    target: str
    time_constant: Parameter
    damping_ratio: Parameter
    own: tuple[float, float] = (0.02, 1.0)
    name = "contact_softness"
    target_kind = "geom"

    def __post_init__(self) -> None:
        if not (self.time_constant.low > 0 and self.damping_ratio.low > 0 and min(self.own) > 0):
            problem = f"{self.key}: a time constant or damping ratio of 0, or a solref of stiffness and damping"
            raise BadInput(problem, "stay above 0; write the model's solref as time constant and damping ratio")

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """T from a quarter to ten times the model's own, zeta from a tenth to twice."""
        time, ratio = scales.contact.time_constant, scales.contact.damping_ratio
        bounds = Parameter(time / 4, time * 10, "s", scale="log")
        return cls(target, bounds, Parameter(0.1 * ratio, 2.0 * ratio), (time, ratio))

    @property
    def parameters(self) -> ParameterSpace:
        """``time_constant`` and ``damping_ratio``."""
        return ParameterSpace({"time_constant": self.time_constant, "damping_ratio": self.damping_ratio})

    @property
    def neutral(self) -> Mapping[str, float]:
        """The model's own."""
        return dict(zip(("time_constant", "damping_ratio"), self.own, strict=True))

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """Contacts that decay twice and five times as slowly, hardly and well damped."""
        times = [min(factor * self.own[0], self.time_constant.high) for factor in (2, 5)]
        low, high = self.damping_ratio.low, self.damping_ratio.high
        ratios = [low + part * (high - low) for part in (0.1, 0.4)]
        return tuple({"time_constant": time, "damping_ratio": ratio} for time in times for ratio in ratios)
