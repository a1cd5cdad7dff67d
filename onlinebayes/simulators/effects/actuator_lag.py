"""A first-order lag of an actuator: T du'/dt = u - u', exact for commands that are held over a timestep.

Over timestep k of length h, with u_k held and u'_k the lagged command at its start,

    u'_{k+1} = u_k + (u'_k - u_k) exp(-h/T)
    mean u'  = u_k + (u'_k - u_k) (T/h) (1 - exp(-h/T)),

and the actuator receives the mean: the impulse over the timestep is the exact one. Before the run began u' was 0.
MuJoCo's ``filter`` applies u'_k instead, half a timestep late; it is not used.
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
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.bounds import non_negative, starts_within
from onlinebayes.simulators.effects.scales import Scales
from onlinebayes.simulators.standalone.commands import Lag


@dataclass(frozen=True)
class ActuatorLag(Effect):
    """First-order lag T of an actuator's command. Hidden state ``"lagged"`` (N,): u'.

    Args:
        target: actuator.
        time_constant: bounds of T >= 0 [s].
    """

    target: str
    time_constant: Parameter
    name = "actuator_lag"
    target_kind = "actuator"
    has_command = True

    def __post_init__(self) -> None:
        non_negative(self.key, "time_constant", self.time_constant)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """T up to the longest plausible dead time."""
        return cls(target, Parameter(0.0, scales.time, "s"))

    @property
    def parameters(self) -> ParameterSpace:
        """``time_constant``."""
        return ParameterSpace({"time_constant": self.time_constant})

    @property
    def neutral(self) -> Mapping[str, float]:
        """T = 0."""
        return {"time_constant": 0.0}

    def standalone(self, values: Mapping[str, float]) -> Lag:
        """See :class:`.Lag`."""
        return Lag(values["time_constant"])

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """A tenth and two fifths of the longest lag: the response to a lag is not small-signal linear."""
        return starts_within("time_constant", self.time_constant, (0.1, 0.4))

    @property
    def memory(self) -> float:
        """Seven of the longest time constants [s], after which a thousandth is left."""
        return 7 * self.time_constant.high

    def rest(self, worlds: int, timestep: float, like: Tensor) -> TensorDict:
        """No command before the run began."""
        lagged = torch.zeros(worlds, dtype=like.dtype, device=like.device)
        return TensorDict({"lagged": lagged}, batch_size=[worlds], device=like.device)

    def command(
        self,
        parameters: Mapping[str, Tensor],
        state: TensorDict | None,
        command: Float[Tensor, "N K"],
        timestep: float,
    ) -> tuple[Float[Tensor, "N K"], TensorDict | None]:
        """Means of u' over the timesteps, and u' after the last one."""
        state = self.rest(len(command), timestep, command) if state is None else state
        ends = self._ends(parameters, state, command, timestep)
        starts = torch.cat([state["lagged"][:, None], ends[:, :-1]], dim=1)
        ratio = _ratio(parameters, timestep)[:, None]
        mean = command + (starts - command) * (-torch.expm1(-ratio) / ratio)
        after = TensorDict({"lagged": ends[:, -1].clone()}, batch_size=[len(command)], device=command.device)
        return torch.where(parameters["time_constant"][:, None] > 0, mean, command), after

    def trace(
        self,
        parameters: Mapping[str, Tensor],
        state: TensorDict | None,
        command: Float[Tensor, "N K"],
        timestep: float,
    ) -> TensorDict | None:
        """u' after each timestep."""
        state = self.rest(len(command), timestep, command) if state is None else state
        ends = self._ends(parameters, state, command, timestep)
        return TensorDict({"lagged": ends}, batch_size=[*command.shape], device=command.device)

    def _ends(
        self, parameters: Mapping[str, Tensor], state: TensorDict, command: Float[Tensor, "N K"], timestep: float
    ) -> Float[Tensor, "N K"]:
        keep, lagged = torch.exp(-_ratio(parameters, timestep)), state["lagged"]
        ends = []
        for u in command.unbind(1):
            lagged = u + (lagged - u) * keep
            ends.append(lagged)
        return torch.stack(ends, dim=1)


def _ratio(parameters: Mapping[str, Tensor], timestep: float) -> Float[Tensor, " N"]:
    """h / T; 1e9 where T is below 1e-9 h, where the lag is gone."""
    return timestep / parameters["time_constant"].clamp_min(1e-9 * timestep)
