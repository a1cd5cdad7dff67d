"""The sliding coefficient of a geom's contacts is mu, whatever touches it; at the model's own the effect is nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.bounds import non_negative
from onlinebayes.simulators.effects.scales import Scales


@dataclass(frozen=True)
class ContactFriction(Effect):
    """Another sliding coefficient of a geom's contacts.

    Args:
        target: geom of a body that moves; or such a body, for all of its geoms.
        friction: bounds of mu >= 0 [1].
        own: the model's own coefficient, at which nothing changes [1].
    """

    target: str
    friction: Parameter
    own: float = 1.0
    name = "contact_friction"
    target_kind = "geom"

    def __post_init__(self) -> None:
        non_negative(self.key, "friction", self.friction)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """mu up to 2, or twice the model's own."""
        own = scales.contact.friction
        return cls(target, Parameter(0.0, max(2.0, 2 * own)), own)

    @property
    def parameters(self) -> ParameterSpace:
        """``friction``."""
        return ParameterSpace({"friction": self.friction})

    @property
    def neutral(self) -> Mapping[str, float]:
        """mu is the model's own."""
        return {"friction": self.own}

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """Well below and above the model's own: what sticks does not show how little it might rub."""
        low, high = self.friction.low, self.friction.high
        parts = (low + 0.3 * (self.own - low), low + 0.7 * (self.own - low), self.own + 0.3 * (high - self.own))
        return tuple({"friction": mu} for mu in parts)
