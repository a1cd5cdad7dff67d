"""An actuator stronger or weaker than modelled: f -> (1 + g) f, carried by MuJoCo in ``gainprm`` and ``biasprm``.

For a motor this is (1 + g) u. For a servo it scales the force, not the goal. Limits of force act after it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.scales import Scales

_LINEAR_GAIN = (mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtGain.mjGAIN_AFFINE)
_LINEAR_BIAS = (mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_AFFINE)


@dataclass(frozen=True)
class ActuatorGain(Effect):
    """(1 + g) f on an actuator.

    Args:
        target: actuator.
        gain: bounds of g > -1 [1].
    """

    target: str
    gain: Parameter
    name = "actuator_gain"
    target_kind = "actuator"
    same_law_as = ("actuator.*.gear[0]",)
    fields = ("actuator_gainprm", "actuator_biasprm")
    has_command = True

    def __post_init__(self) -> None:
        if self.gain.low <= -1:
            raise BadInput(f"{self.key}.gain may be {self.gain.low:g}", "at -1 the actuator is dead: stay above it")

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """From a fifth of the force to four times as much."""
        return cls(target, Parameter(-0.8, 3.0, ""))

    @property
    def parameters(self) -> ParameterSpace:
        """``gain``."""
        return ParameterSpace({"gain": self.gain})

    @property
    def neutral(self) -> Mapping[str, float]:
        """g = 0."""
        return {"gain": 0.0}

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Refuse an actuator whose force is not linear in its gain and bias parameters (muscle, DC motor)."""
        actuator = spec.actuator(self.target)
        if actuator.gaintype not in _LINEAR_GAIN or actuator.biastype not in _LINEAR_BIAS:
            raise BadInput(
                f"{self.key}: the actuator's force is not linear in its parameters",
                "use a motor, a servo or a general actuator with affine gain and bias",
            )

    def write(
        self, model: mujoco.MjModel, fields: Mapping[str, np.ndarray], parameters: Mapping[str, np.ndarray]
    ) -> None:
        """``gainprm``, ``biasprm`` times (1 + g)."""
        i = int(model.actuator(self.target).id)
        factor = 1.0 + parameters["gain"][:, None]
        fields["actuator_gainprm"][:, i] *= factor
        fields["actuator_biasprm"][:, i] *= factor

    def command(
        self,
        parameters: Mapping[str, Tensor],
        state: TensorDict | None,
        command: Float[Tensor, "N K"],
        timestep: float,
    ) -> tuple[Float[Tensor, "N K"], TensorDict | None]:
        """(1 + g) u, for a backend whose actuators are pure forces."""
        return command * (1.0 + parameters["gain"][:, None]), state
