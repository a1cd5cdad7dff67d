"""A command that cannot change faster than a limit: a servo that moves towards its goal no faster than it is set to.

    u'_k = u'_{k-1} + clip(u_k - u'_{k-1}, -s h, s h)

u the command, u' what the actuator follows, s the limit [command units/s], h the timestep [s]. Controllers of hobby
servos profile their goals so (bam's model of Feetech servos, https://github.com/Rhoban/bam, ``bam/feetech``). An effect
of one's own: the problem file names this module under ``[effects] modules``, which registers it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self, final

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import EFFECTS, Effect, Scales
from onlinebayes.simulators.effects.bounds import starts_within

MEMORY = 2.0
"""Time within which the actuator has met its command, wherever it came from [s]."""


@final
@dataclass(frozen=True)
class ActuatorRateLimit(Effect):
    """The actuator follows its command no faster than a limit. Hidden state ``"reached"`` (N,): u'.

    Args:
        target: actuator.
        limit: bounds of s; the upper one is no limit at all [command units/s].
    """

    target: str
    limit: Parameter
    name = "actuator_rate_limit"
    target_kind = "actuator"
    has_command = True

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """From a tenth of the joint's largest speed to ten times that, which no command of a servo asks for."""
        return cls(target, Parameter(0.1 * scales.speed, 10.0 * scales.speed, ""))

    @property
    def parameters(self) -> ParameterSpace:
        """``limit``."""
        return ParameterSpace({"limit": self.limit})

    @property
    def neutral(self) -> Mapping[str, float]:
        """The upper bound."""
        return {"limit": self.limit.high}

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """A twentieth and a tenth of it, about the joint's own speeds: a limit out of reach moves nothing."""
        return starts_within("limit", self.limit, (0.05, 0.1))

    @property
    def memory(self) -> float:
        """See :data:`MEMORY`."""
        return MEMORY

    def rest(self, worlds: int, timestep: float, like: Tensor) -> TensorDict:
        """At 0 before the run began."""
        reached = torch.zeros(worlds, dtype=like.dtype, device=like.device)
        return TensorDict({"reached": reached}, batch_size=[worlds], device=like.device)

    def command(
        self,
        parameters: Mapping[str, Tensor],
        state: TensorDict | None,
        command: Float[Tensor, "N K"],
        timestep: float,
    ) -> tuple[Float[Tensor, "N K"], TensorDict | None]:
        """u' on each timestep, and the last one."""
        reached = self._reached(parameters, state, command, timestep)
        after = TensorDict({"reached": reached[:, -1].clone()}, batch_size=[len(command)], device=command.device)
        return reached, after

    def trace(
        self,
        parameters: Mapping[str, Tensor],
        state: TensorDict | None,
        command: Float[Tensor, "N K"],
        timestep: float,
    ) -> TensorDict | None:
        """u' after each timestep."""
        reached = self._reached(parameters, state, command, timestep)
        return TensorDict({"reached": reached}, batch_size=[*command.shape], device=command.device)

    def _reached(
        self, parameters: Mapping[str, Tensor], state: TensorDict | None, command: Float[Tensor, "N K"], timestep: float
    ) -> Float[Tensor, "N K"]:
        state = self.rest(len(command), timestep, command) if state is None else state
        limit, at = parameters["limit"], state["reached"]
        step, free = limit * timestep, limit >= self.limit.high
        line = []
        for u in command.unbind(1):
            at = torch.where(free, u, at + torch.minimum(torch.maximum(u - at, -step), step))
            line.append(at)
        return torch.stack(line, dim=1)


EFFECTS[ActuatorRateLimit.name] = ActuatorRateLimit
