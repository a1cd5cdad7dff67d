"""Dry (Coulomb) friction of a joint: -F sign(v) in motion, up to F at rest, carried by MuJoCo as ``dof_frictionloss``.

MuJoCo's friction constraint is soft: a joint that should stick under a load tau creeps at

    v = (1 - d) / d * (tau / I) * t_c * d / 2,      d the constraint's impedance, t_c its time constant,

with the defaults (d = .9, t_c = 20 ms) 1e-3 s times the acceleration the load would cause, which a fit takes for
viscous slip. The effect therefore sets ``solimp_friction`` to MuJoCo's largest impedance, .9999: 1e-6 s times it. It
does so only in worlds where it adds friction: at F = 0 nothing changes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np
from jaxtyping import Float
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects.base import Effect, Scales
from onlinebayes.simulators.effects.bounds import joint_unit, non_negative

SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)
"""``solimp_friction`` under the effect: constant impedance d = .9999, the largest that MuJoCo takes."""


@dataclass(frozen=True)
class DryFriction(Effect):
    """Coulomb friction on a slide or hinge joint; it adds to the frictionloss that the model has.

    Args:
        target: joint.
        frictionloss: bounds of F >= 0 [N, N m].
    """

    target: str
    frictionloss: Parameter
    name = "dry_friction"
    target_kind = "joint"
    fields = ("dof_frictionloss", "dof_solimp")

    def __post_init__(self) -> None:
        non_negative(self.key, "frictionloss", self.frictionloss)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """F up to the largest force in play."""
        return cls(target, Parameter(0.0, scales.force, joint_unit(scales.unit, "N", "N m")))

    @property
    def parameters(self) -> ParameterSpace:
        """``frictionloss``."""
        return ParameterSpace({"frictionloss": self.frictionloss})

    @property
    def neutral(self) -> Mapping[str, float]:
        """F = 0."""
        return {"frictionloss": 0.0}

    def write(
        self, model: mujoco.MjModel, fields: Mapping[str, np.ndarray], parameters: Mapping[str, np.ndarray]
    ) -> None:
        """``dof_frictionloss += F``, and a hard ``dof_solimp`` where F > 0."""
        dof = int(model.joint(self.target).dofadr[0])
        bound = parameters["frictionloss"]
        fields["dof_frictionloss"][:, dof] += bound
        fields["dof_solimp"][bound > 0, dof] = SOLIMP

    def friction_bound(self, parameters: Mapping[str, Tensor]) -> Float[Tensor, " N"]:
        """F [N, N m]."""
        return parameters["frictionloss"]
