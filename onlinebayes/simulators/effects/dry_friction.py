"""Dry (Coulomb) friction of a joint: -F sign(v) in motion, up to F at rest, carried by MuJoCo as ``dof_frictionloss``.

MuJoCo's friction constraint is soft: it asks for the acceleration -b v, where Coulomb asks for v = 0 at once, so that
under another torque tau it changes sign while v is still tau / (I b): the friction acts as -F sign(v(t + 1 / b)). With
the defaults 1 / b is 10 ms, which a fit takes for a spring. A joint that should stick creeps at

    v = (1 - d) / d * (tau / I) / b,                d the constraint's impedance,

with the defaults (d = .9) 1e-3 s times the acceleration that the load would cause, which a fit takes for viscous slip.
The effect therefore sets ``solimp_friction`` to MuJoCo's largest impedance, .9999, and ``solref_friction`` to the
largest b that the integrator bears: 1 / timestep for a first-order one (v is zero after one step), 2 / timestep for
RK4 (its limit is 2.8). It does so only in worlds where it adds friction: at F = 0 nothing changes.
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
RATE = {mujoco.mjtIntegrator.mjINT_RK4: 2.0}
"""b times the timestep, by integrator; 1 for the others."""


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
    fields = ("dof_frictionloss", "dof_solimp", "dof_solref")

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
        """See :func:`add_friction`."""
        add_friction(model, fields, self.target, parameters["frictionloss"])

    def friction_bound(self, parameters: Mapping[str, Tensor]) -> Float[Tensor, " N"]:
        """F [N, N m]."""
        return parameters["frictionloss"]


def add_friction(
    model: mujoco.MjModel, fields: Mapping[str, np.ndarray], joint: str, bound: Float[np.ndarray, " N"]
) -> None:
    """``dof_frictionloss += F`` [N, N m], and a hard ``dof_solimp`` and ``dof_solref`` where F > 0."""
    dof = int(model.joint(joint).dofadr[0])
    fields["dof_frictionloss"][:, dof] += bound
    fields["dof_solimp"][bound > 0, dof] = SOLIMP
    # Negative values are stiffness (without meaning for friction) and b, which mjModel divides by the impedance.
    rate = RATE.get(mujoco.mjtIntegrator(model.opt.integrator), 1.0) / model.opt.timestep
    fields["dof_solref"][bound > 0, dof] = (-1.0, -rate * SOLIMP[0])
