"""A limit on how fast an actuator's command changes: abs(du'/dt) <= L, as the drives of wheels and servos have it.

Over timesteps of length h, with u_k the command and u'_k what is let through,

    u'_k = u'_{k-1} + clip(u_k - u'_{k-1}, -L h, L h)  =  clip(u_k, u'_{k-1} - L h, u'_{k-1} + L h),

the second form because it lets u_k through bit for bit where the limit is not reached. So do the speed limiters of
ros2_controllers (user documentation of ``diff_drive_controller``). A ramp is a staircase that is half a timestep ahead
of the continuous one. Before the run began u' was 0; the state in which a window in the middle of a run begins comes
from the commands before it (:attr:`ActuatorRateLimit.memory`). "No limit" is a value of L like any other, the upper
bound of the parameter: there, and only there, nothing is held back.
"""

from __future__ import annotations

import math
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
from onlinebayes.simulators.effects.scales import Scales


@dataclass(frozen=True)
class ActuatorRateLimit(Effect):
    """A limit L on the rate of an actuator's command. Hidden state ``"last"`` (N,): u', the last one let through.

    It acts on the command: for a servo, on the goal.

    Args:
        target: actuator.
        limit: bounds of L > 0 [command units/s]; at the upper one the rate is not limited.
        swing: largest change of the command > 0, e.g. from its lowest to its highest value [command units]. It says
            for how long commands are remembered, and changes nothing of the motion.
    """

    target: str
    limit: Parameter
    swing: float = 2.0
    name = "actuator_rate_limit"
    target_kind = "actuator"
    by_name = True
    has_command = True

    def __post_init__(self) -> None:
        if self.limit.low <= 0 or not 0 < self.swing < math.inf:
            raise BadInput(
                f"{self.key}: limit from {self.limit.low:g}, swing {self.swing:g}",
                "a limit of 0 would let no command through, ever: stay above 0, and finite",
            )

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """L at which the commands' whole range takes from 20 of the longest dead times to a hundredth of one."""
        swing = 2 * scales.force
        limit = Parameter(swing / (20 * scales.time), swing / (0.01 * scales.time), "1/s", scale="log")
        return cls(target, limit, swing)

    @property
    def parameters(self) -> ParameterSpace:
        """``limit``."""
        return ParameterSpace({"limit": self.limit})

    @property
    def neutral(self) -> Mapping[str, float]:
        """L at its upper bound: no limit."""
        return {"limit": self.limit.high}

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """Limits within reach, from one that bends fast commands to one that hardly follows: others move nothing."""
        low, high = self.limit.low, self.limit.high
        return tuple({"limit": low ** (1 - part) * high**part} for part in (0.6, 0.45, 0.3, 0.15))

    @property
    def memory(self) -> float:
        """What the slowest limit needs from one end of the commands to the other [s].

        Two pasts of the same commands come nearer by up to 2 L h in each timestep whose command lies between them, and
        are one as soon as both let it through; away from the slowest limit that happens well before.
        """
        return self.swing / self.limit.low

    def rest(self, worlds: int, timestep: float, like: Tensor) -> TensorDict:
        """No command before the run began."""
        last = torch.zeros(worlds, dtype=like.dtype, device=like.device)
        return TensorDict({"last": last}, batch_size=[worlds], device=like.device)

    def command(
        self,
        parameters: Mapping[str, Tensor],
        state: TensorDict | None,
        command: Float[Tensor, "N K"],
        timestep: float,
    ) -> tuple[Float[Tensor, "N K"], TensorDict | None]:
        """What is let through on each timestep, and the last of it."""
        passed = self._passed(parameters, state, command, timestep)
        after = TensorDict({"last": passed[:, -1].clone()}, batch_size=[len(command)], device=command.device)
        return passed, after

    def trace(
        self,
        parameters: Mapping[str, Tensor],
        state: TensorDict | None,
        command: Float[Tensor, "N K"],
        timestep: float,
    ) -> TensorDict | None:
        """u' after each timestep: what was let through on it."""
        passed = self._passed(parameters, state, command, timestep)
        return TensorDict({"last": passed}, batch_size=[*command.shape], device=command.device)

    def _passed(
        self, parameters: Mapping[str, Tensor], state: TensorDict | None, command: Float[Tensor, "N K"], timestep: float
    ) -> Float[Tensor, "N K"]:
        last = (self.rest(len(command), timestep, command) if state is None else state)["last"]
        limit = parameters["limit"]
        reach = torch.where(limit < self.limit.high, limit * timestep, torch.inf)
        passed = []
        for u in command.unbind(1):
            last = torch.minimum(torch.maximum(u, last - reach), last + reach)
            passed.append(last)
        return torch.stack(passed, dim=1)
