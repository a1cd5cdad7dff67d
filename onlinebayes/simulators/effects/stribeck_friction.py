"""Dry friction that falls with speed: -(Fc + (Fs - Fc) exp(-(v / vs)^2)) sign(v), holding up to Fs at rest.

Stribeck's curve in the form of Bo and Pavelescu (1982) with exponent 2, as in Armstrong-Helouvry, Dupont and Canudas
de Wit (1994), eq. 6. Its size is taken at the start of a step, its sign by the solver at the end, so that it sticks.
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
from onlinebayes.simulators.effects.bounds import divides, geometric, joint_unit, non_negative
from onlinebayes.simulators.effects.scales import Scales
from onlinebayes.simulators.effects.seen import Seen
from onlinebayes.simulators.standalone.frictions import Stribeck


@dataclass(frozen=True)
class StribeckFriction(Effect):
    """Stribeck friction on a slide or hinge joint; with Fs = Fc it is dry friction.

    Args:
        target: joint.
        coulomb: bounds of Fc >= 0, the friction at high speed [N, N m].
        static: bounds of Fs >= 0, the friction at rest [N, N m].
        stribeck_velocity: bounds of vs > 0 [m/s, rad/s].
    """

    target: str
    coulomb: Parameter
    static: Parameter
    stribeck_velocity: Parameter
    name = "stribeck_friction"
    target_kind = "joint"
    contains = ("dry_friction",)

    def __post_init__(self) -> None:
        non_negative(self.key, "coulomb", self.coulomb)
        non_negative(self.key, "static", self.static)
        divides(self.key, "stribeck_velocity", self.stribeck_velocity)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """Fc and Fs up to the largest force in play; vs from a thousandth to all of the largest speed."""
        force = Parameter(0.0, scales.force, joint_unit(scales.unit, "N", "N m"))
        unit = joint_unit(scales.unit, "m/s", "rad/s")
        return cls(target, force, force, Parameter(1e-3 * scales.speed, scales.speed, unit, scale="log"))

    @property
    def parameters(self) -> ParameterSpace:
        """``coulomb``, ``static`` and ``stribeck_velocity``."""
        return ParameterSpace(
            {"coulomb": self.coulomb, "static": self.static, "stribeck_velocity": self.stribeck_velocity}
        )

    @property
    def magnitude(self) -> str:
        """``static``: beside dry friction, which it contains, the law's own is what holds at rest."""
        return "static"

    @property
    def neutral(self) -> Mapping[str, float]:
        """Fc = Fs = 0; vs, without meaning then, is the geometric middle of its bounds."""
        return {"coulomb": 0.0, "static": 0.0, "stribeck_velocity": geometric(self.stribeck_velocity, 0.5)}

    def standalone(self, values: Mapping[str, float]) -> Stribeck:
        """See :class:`.Stribeck`."""
        return Stribeck(values["coulomb"], values["static"], values["stribeck_velocity"])

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """The excess of static friction, at two sizes and three Stribeck velocities; and both frictions at once.

        The largest force in play may be a hundred times what rubs: a trial of that size would only stick.
        """
        least, most = (part * self.static.high for part in (1e-3, 1e-2))
        excess = tuple(
            {"coulomb": 0.0, "static": size, "stribeck_velocity": geometric(self.stribeck_velocity, part)}
            for size in (least, most)
            for part in (0.25, 0.5, 0.75)
        )
        both = 0.05 * self.coulomb.high
        return (
            *excess,
            {
                "coulomb": both,
                "static": min(2 * both, self.static.high),
                "stribeck_velocity": geometric(self.stribeck_velocity, 0.5),
            },
        )

    def friction_bound(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """Fc + (Fs - Fc) exp(-(v / vs)^2) [N, N m]."""
        near = torch.exp(-(seen.v / parameters["stribeck_velocity"]).square())
        # As a mixture of two forces that are not negative it cannot become so by rounding.
        return parameters["coulomb"] * (1.0 - near) + parameters["static"] * near
