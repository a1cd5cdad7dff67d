"""Load-dependent friction that is gone at speed: up to mu abs(f) exp(-(v / vs)^2), f the actuators' force at a joint.

Stribeck's hump (see :mod:`.stribeck_friction`) of teeth that are pressed together by the torque that they pass on. It
adds to :mod:`.load_dependent_friction`, which stays at speed (the load-dependent Stribeck term of Duclusaud, Passault,
Padois and Ly 2025, with exponent 2 and the drive's torque alone).
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
from onlinebayes.simulators.standalone.frictions import LoadStribeck


@dataclass(frozen=True)
class LoadDependentStribeck(Effect):
    """Dry friction of size mu abs(f) at rest, which is gone at speed, on a slide or hinge joint.

    Args:
        target: joint.
        mu: bounds of mu >= 0 [1].
        stribeck_velocity: bounds of vs > 0 [m/s, rad/s].
    """

    target: str
    mu: Parameter
    stribeck_velocity: Parameter
    name = "load_dependent_stribeck"
    target_kind = "joint"
    needs_drive = True
    tried_at_servos = True  # elsewhere stribeck_friction says as much

    def __post_init__(self) -> None:
        non_negative(self.key, "mu", self.mu)
        divides(self.key, "stribeck_velocity", self.stribeck_velocity)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """mu up to 1; vs from a thousandth to all of the largest speed."""
        unit = joint_unit(scales.unit, "m/s", "rad/s")
        return cls(target, Parameter(0.0, 1.0, ""), Parameter(1e-3 * scales.speed, scales.speed, unit, scale="log"))

    @property
    def parameters(self) -> ParameterSpace:
        """``mu`` and ``stribeck_velocity``."""
        return ParameterSpace({"mu": self.mu, "stribeck_velocity": self.stribeck_velocity})

    @property
    def neutral(self) -> Mapping[str, float]:
        """mu = 0; vs, without meaning then, is the geometric middle of its bounds."""
        return {"mu": 0.0, "stribeck_velocity": geometric(self.stribeck_velocity, 0.5)}

    def standalone(self, values: Mapping[str, float]) -> LoadStribeck:
        """See :class:`.LoadStribeck`."""
        return LoadStribeck(values["mu"], values["stribeck_velocity"])

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """A tenth of the largest mu at three Stribeck velocities."""
        mu = self.mu.low + 0.1 * (self.mu.high - self.mu.low)
        return tuple(
            {"mu": mu, "stribeck_velocity": geometric(self.stribeck_velocity, part)} for part in (0.35, 0.6, 0.85)
        )

    def friction_bound(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """mu abs(f) exp(-(v / vs)^2) [N, N m]."""
        near = torch.exp(-(seen.v / parameters["stribeck_velocity"]).square())
        return parameters["mu"] * seen.drive.abs() * near
