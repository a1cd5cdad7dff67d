"""A point mass that a body carries: m -> m + dm, at the body's own centre of mass or at one of its sites.

At the centre (``payload@body``) the inertia about it stays: MuJoCo's ``body_mass``; where that mass is free already, it
is that mass. At a site (``payload@site``) a welded body of mass dm is added there, which also moves the centre.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np

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
    fields = ("body_mass",)

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

    def edit(self, spec: mujoco.MjSpec) -> None:
        """A welded body at the site, without mass until :meth:`write` gives it one."""
        if spec.body(self.target) is not None:
            return
        # Not fused with its parent, which would make it nameless.
        spec.compiler.fusestatic = False
        site = spec.site(self.target)
        place = spec.copy().compile().site(self.target).pos
        carried = site.parent.add_body(name=self.key, pos=place, ipos=np.zeros(3), mass=0.0, inertia=np.zeros(3))
        carried.explicitinertial = True

    def write(
        self, model: mujoco.MjModel, fields: Mapping[str, np.ndarray], parameters: Mapping[str, np.ndarray]
    ) -> None:
        """``body_mass += dm``, of the body or of the one at the site."""
        bodies = {model.body(k).name for k in range(model.nbody)}
        carrier = self.target if self.target in bodies else self.key
        fields["body_mass"][:, int(model.body(carrier).id)] += parameters["mass"]
