"""A point mass that a body carries: m -> m + dm, at the body's own centre of mass or at one of its sites.

At the centre (``payload@body``) the inertia about it stays; where the body's mass is free already, it is that mass.
At a site (``payload@site``) the centre of mass moves too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.bounds import non_negative
from onlinebayes.simulators.effects.scales import Scales


@dataclass(frozen=True)
class Payload(Effect):
    """A point mass dm carried at a body's centre of mass, or at a site.

    Args:
        target: body that a joint moves, or a site of such a body (of a body and a site of one name, the body).
        mass: bounds of dm >= 0 [kg].
    """

    target: str
    mass: Parameter
    name = "payload"
    target_kind = "body"
    same_law_as = ("body.*.mass",)
    wider = ("site",)

    def __post_init__(self) -> None:
        non_negative(self.key, "mass", self.mass)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """dm up to twice the body's own mass; at a site, that of the heaviest body."""
        return cls(target, Parameter(0.0, 2 * scales.inertia, "kg"))

    @property
    def parameters(self) -> ParameterSpace:
        """``mass``."""
        return ParameterSpace({"mass": self.mass})

    @property
    def neutral(self) -> Mapping[str, float]:
        """dm = 0."""
        return {"mass": 0.0}
