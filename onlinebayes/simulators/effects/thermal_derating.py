"""A motor that weakens as it heats up: f / (1 + c h), with the heat T dh/dt = (f / f_ref)^2 - h.

h is the winding's excess of temperature in units of the one that it reaches under f_ref held for ever (copper losses
go as the square of the current, cooling as the excess: one thermal time constant); c h is by how much its resistance,
and so the current that a voltage drives, has changed. f is the actuator's force without the effect. Over a timestep f
is held, so that the step is exact:  h+ = w h + (1 - w) (f / f_ref)^2,  w = exp(-timestep / T).
The force of a step takes the heat at its middle: that of its start would lag by half a timestep (1 ms against T = .4 s
moved a fitted T by 6 %).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.bounds import geometric, non_negative
from onlinebayes.simulators.effects.scales import Scales
from onlinebayes.simulators.effects.seen import Seen
from onlinebayes.simulators.standalone.motors import Heat


@dataclass(frozen=True)
class ThermalDerating(Effect):
    """f / (1 + c h) on an actuator. Hidden state ``"heat"`` (N,): h, zero for a cold motor.

    Args:
        target: actuator.
        coefficient: bounds of c >= 0 [1].
        time_constant: bounds of T > 0 [s].
        reference: f_ref > 0, the force that heats to h = 1 [the actuator's force, before the gear]; only c / f_ref^2
            matters, so that it is a unit rather than a parameter.
    """

    target: str
    coefficient: Parameter
    time_constant: Parameter
    reference: float = 1.0
    name = "thermal_derating"
    target_kind = "actuator"
    needs_drive = True

    def __post_init__(self) -> None:
        non_negative(self.key, "coefficient", self.coefficient)
        if self.time_constant.low <= 0 or not self.reference > 0:
            raise BadInput(
                f"{self.key}: time_constant from {self.time_constant.low:g} s, reference {self.reference:g}",
                "the heat is divided by both: stay above 0",
            )

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """c up to 5; T from 2 to 2000 times the longest dead time (parts of a horizon to hundreds of them)."""
        time = Parameter(2 * scales.time, 2000 * scales.time, "s", scale="log")
        return cls(target, Parameter(0.0, 5.0, ""), time, scales.force)

    @property
    def parameters(self) -> ParameterSpace:
        """``coefficient`` and ``time_constant``."""
        return ParameterSpace({"coefficient": self.coefficient, "time_constant": self.time_constant})

    @property
    def neutral(self) -> Mapping[str, float]:
        """c = 0; T, without meaning then, is the geometric middle of its bounds."""
        return {"coefficient": 0.0, "time_constant": geometric(self.time_constant, 0.5)}

    def standalone(self, values: Mapping[str, float]) -> Heat:
        """See :class:`.Heat`."""
        return Heat(values["coefficient"], values["time_constant"], self.reference)

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """A weak derating with a short, a middling and a long time constant."""
        coefficient = 0.1 * self.coefficient.high
        return tuple(
            {"coefficient": coefficient, "time_constant": geometric(self.time_constant, part)}
            for part in (0.3, 0.5, 0.7)
        )

    @property
    def memory(self) -> float:
        """Five of the longest time constants [s], after which a hundredth of the heat is left."""
        return 5 * self.time_constant.high

    def rest(self, worlds: int, timestep: float, like: Tensor) -> TensorDict:
        """A cold motor."""
        heat = torch.zeros(worlds, dtype=like.dtype, device=like.device)
        return TensorDict({"heat": heat}, batch_size=[worlds], device=like.device)

    def force(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """f / (1 + c h) - f, written so that it is zero for c = 0 [N, N m at the transmission]."""
        loss = parameters["coefficient"] * self._heat(parameters, seen, 0.5)
        return -seen.drive * (loss / (1.0 + loss))

    def advance(self, parameters: Mapping[str, Tensor], seen: Seen) -> TensorDict:
        """The heat at the end of the step."""
        heat = self._heat(parameters, seen, 1.0)
        return TensorDict({"heat": heat}, batch_size=heat.shape, device=heat.device)

    def along(self, parameters: Mapping[str, Tensor], seen: Seen) -> TensorDict:
        """The heat after each of K rows: a geometric sum, doubled in log2 K steps (Hillis and Steele 1986)."""
        assert seen.hidden is not None
        kept = torch.exp(-seen.timestep / parameters["time_constant"])[:, None]
        heat = (1.0 - kept) * (seen.drive / self.reference).square()
        heat = torch.cat([heat[:, :1] + kept * seen.hidden["heat"][:, None], heat[:, 1:]], dim=1)
        shift = 1
        while shift < heat.shape[1]:
            heat = torch.cat([heat[:, :shift], heat[:, shift:] + kept * heat[:, :-shift]], dim=1)
            shift, kept = 2 * shift, kept.square()
        return TensorDict({"heat": heat}, batch_size=heat.shape, device=heat.device)

    def _heat(self, parameters: Mapping[str, Tensor], seen: Seen, part: float) -> Float[Tensor, " N"]:
        """h after this part of the step."""
        assert seen.hidden is not None
        kept = torch.exp(-part * seen.timestep / parameters["time_constant"])
        return kept * seen.hidden["heat"] + (1.0 - kept) * (seen.drive / self.reference).square()
