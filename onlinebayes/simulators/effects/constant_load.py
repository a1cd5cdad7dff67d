"""A constant force at a joint, either sign, carried by MuJoCo as one more actuator that has a bias and no input.

tau = L:      gain 0, bias (L, 0, 0), gear 1
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
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.bounds import joint_unit
from onlinebayes.simulators.effects.scales import Scales
from onlinebayes.simulators.effects.seen import Seen


@dataclass(frozen=True)
class ConstantLoad(Effect):
    """A constant force L on a slide or hinge joint.

    Args:
        target: joint.
        load: bounds of L [N, N m].
    """

    target: str
    load: Parameter
    name = "constant_load"
    target_kind = "joint"
    fields = ("actuator_biasprm",)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """L up to the largest force in play, either sign."""
        return cls(target, Parameter(-scales.force, scales.force, joint_unit(scales.unit, "N", "N m")))

    @property
    def parameters(self) -> ParameterSpace:
        """``load``."""
        return ParameterSpace({"load": self.load})

    @property
    def neutral(self) -> Mapping[str, float]:
        """L = 0."""
        return {"load": 0.0}

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Append the actuator, named like the effect; it is no command of the simulator."""
        add_load_actuator(spec, self.key, self.target)

    def write(
        self, model: mujoco.MjModel, fields: Mapping[str, np.ndarray], parameters: Mapping[str, np.ndarray]
    ) -> None:
        """``actuator_biasprm[0] = L`` of the effect's own actuator."""
        fields["actuator_biasprm"][:, int(model.actuator(self.key).id), 0] = parameters["load"]

    def force(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """L [N, N m]."""
        return parameters["load"]


def add_load_actuator(spec: mujoco.MjSpec, name: str, joint: str) -> None:
    """Append an actuator whose force is ``biasprm[0]`` and nothing else."""
    actuator = spec.add_actuator()
    actuator.name, actuator.target = name, joint
    actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    actuator.gainprm[0] = 0.0
