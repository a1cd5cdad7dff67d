"""A dead time of an actuator: u(t) -> u(t - T), exact for commands that are held over a timestep.

The command is a staircase: u_k holds over timestep k of length h. Delayed by T = (n + f) h, n whole and 0 <= f < 1, its
average over timestep k is

    u'_k = (1 - f) u_{k-n} + f u_{k-n-1},

linear interpolation between timesteps: the slope in T is never zero, as it would be were T rounded. Before the run
began commands were 0. Plain MuJoCo's ``delay`` with ``interp="linear"`` computes the same (see export).
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
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.bounds import non_negative, starts_within
from onlinebayes.simulators.effects.scales import Scales
from onlinebayes.simulators.standalone.commands import DeadTime


@dataclass(frozen=True)
class ActuatorDelay(Effect):
    """u(t - T) on an actuator. Hidden state ``"past"`` (N, L): the last L commands, oldest first.

    Args:
        target: actuator.
        delay: bounds of T >= 0 [s]; L = ceil(high / timestep) + 1.
    """

    target: str
    delay: Parameter
    name = "actuator_delay"
    target_kind = "actuator"
    has_command = True

    def __post_init__(self) -> None:
        non_negative(self.key, "delay", self.delay)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """T up to the longest plausible dead time."""
        return cls(target, Parameter(0.0, scales.time, "s"))

    @property
    def parameters(self) -> ParameterSpace:
        """``delay``."""
        return ParameterSpace({"delay": self.delay})

    @property
    def neutral(self) -> Mapping[str, float]:
        """T = 0."""
        return {"delay": 0.0}

    def standalone(self, values: Mapping[str, float]) -> DeadTime:
        """See :class:`.DeadTime`."""
        return DeadTime(values["delay"])

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """A tenth and two fifths of the longest dead time: the response to a delay is not small-signal linear."""
        return starts_within("delay", self.delay, (0.1, 0.4))

    @property
    def memory(self) -> float:
        """The longest delay [s]."""
        return self.delay.high

    def length(self, timestep: float) -> int:
        """L, the number of past commands that the longest delay can reach."""
        return math.ceil(self.delay.high / timestep - 1e-9) + 1

    def rest(self, worlds: int, timestep: float, like: Tensor) -> TensorDict:
        """No command before the run began."""
        past = torch.zeros(worlds, self.length(timestep), dtype=like.dtype, device=like.device)
        return TensorDict({"past": past}, batch_size=[worlds], device=like.device)

    def command(
        self,
        parameters: Mapping[str, Tensor],
        state: TensorDict | None,
        command: Float[Tensor, "N K"],
        timestep: float,
    ) -> tuple[Float[Tensor, "N K"], TensorDict | None]:
        """The delayed commands and the new past; a delay outside its bounds is taken as the bound."""
        worlds, steps = command.shape
        state = self.rest(worlds, timestep, command) if state is None else state
        line = torch.cat([state["past"], command], dim=1)
        length = line.shape[1] - steps
        delay = (parameters["delay"] / timestep).clamp(0.0, float(length - 1))
        whole = delay.floor()
        part = (delay - whole)[:, None]
        newest = torch.arange(length, length + steps, device=command.device)[None] - whole.long()[:, None]
        near, far = line.gather(1, newest), line.gather(1, newest - 1)
        delayed = torch.where(part > 0, (1 - part) * near + part * far, near)
        past = TensorDict({"past": line[:, -length:].clone()}, batch_size=[worlds], device=command.device)
        return delayed, past

    def trace(
        self,
        parameters: Mapping[str, Tensor],
        state: TensorDict | None,
        command: Float[Tensor, "N K"],
        timestep: float,
    ) -> TensorDict | None:
        """Windows of L commands that slide over one line: views, no copies."""
        state = self.rest(len(command), timestep, command) if state is None else state
        line = torch.cat([state["past"], command], dim=1)
        past = line.unfold(1, line.shape[1] - command.shape[1], 1)[:, 1:]
        return TensorDict({"past": past}, batch_size=[*command.shape], device=command.device)
