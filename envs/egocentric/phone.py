"""A phone whose battery empties: slowly while its motion sensors run, faster while its camera runs too.

    c' = c - dt / 3600 (i_motion + u i_camera),    c >= 0

c charge left [mAh]; u in [0, 1] the share of the step in which the camera runs; theta = (i_motion, i_camera), the
current that is always drawn and the one that the camera adds [mA]. Heat raises both: they are what a battery log tells.
The thesis gives 150 mAh for motion alone and 450 mAh for vision, without a duration (Figure 3.7); we take them as those
of an hour, so that the phone draws 150 mA, and the camera 300 mA more.

| key of a state | shape  | meaning                                                         |
|----------------|--------|-----------------------------------------------------------------|
| ``"qpos"``     | (N, 1) | charge left [mAh]                                               |
| ``"qvel"``     | (N, 1) | its rate over the last step [mA], below zero; read, never set   |
| ``"clock"``    | (N, 1) | seconds since the start [s]; zero where a given state lacks it  |
"""

from __future__ import annotations

from typing import Self, final

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Simulator
from onlinebayes.simulators.by_steps import by_steps
from onlinebayes.simulators.effects import Effect

HOUR = 3600.0
"""[s]"""

CURRENTS = ParameterSpace(
    {"motion": Parameter(75.0, 600.0, "mA", "log"), "camera": Parameter(150.0, 1200.0, "mA", "log")}
)
"""Half to four times the thesis's."""

CAPACITY = 3000.0
"""Of a full battery [mAh]."""

NOMINAL = {"motion": 150.0, "camera": 300.0}


@final
class Phone(Simulator):
    """N phones.

    Args:
        worlds: number of phones N.
        dt: seconds of a step [s].
        capacity: charge of a full battery, with which phones start unless told otherwise [mAh].
        device, dtype: of every tensor.
    """

    def __init__(
        self,
        worlds: int = 1,
        dt: float = 1.0,
        capacity: float = CAPACITY,
        device: torch.device | str = "cpu",
        dtype: torch.dtype = torch.float64,
    ) -> None:
        if worlds < 1:
            raise BadInput(f"worlds = {worlds}", "a simulator has at least one world")
        if not (dt > 0 and capacity > 0):
            raise BadInput(f"dt = {dt:g} s, capacity = {capacity:g} mAh", "both must be positive")
        self.parameters, self.worlds, self.dt, self.capacity = CURRENTS, worlds, dt, capacity
        self.device, self.dtype = torch.device(device), dtype
        self._theta = self.nominal.repeat(worlds, 1)
        self._charge, self._rate, self._clock = (torch.zeros(worlds, 1, dtype=dtype, device=device) for _ in range(3))
        self._failed = torch.zeros(worlds, dtype=torch.bool, device=device)
        self.reset(self._theta)

    @property
    def nominal(self) -> Float[Tensor, " P"]:
        """The thesis's currents [mA]."""
        return self.parameters.vector(NOMINAL, dtype=self.dtype, device=self.device)

    @property
    def theta(self) -> Float[Tensor, "N P"]:
        """A copy of every phone's currents [mA]."""
        return self._theta.clone()

    @property
    def state(self) -> TensorDict:
        """A copy of the complete state; see the module."""
        values = {"qpos": self._charge.clone(), "qvel": self._rate.clone(), "clock": self._clock.clone()}
        return TensorDict(values, batch_size=(self.worlds,), device=self.device)

    @property
    def failed(self) -> Bool[Tensor, " N"]:
        """Phones whose command was no number."""
        return self._failed.clone()

    def reset(
        self,
        theta: Float[Tensor, "N P"],
        state: TensorDictBase | None = None,
        mask: Bool[Tensor, " N"] | None = None,
    ) -> TensorDict:
        """New currents and states for the phones under ``mask``; see :meth:`Simulator.reset`."""
        full = torch.full_like(self._charge, self.capacity)
        charge = full if state is None else state.get("qpos").to(full)
        clock = None if state is None else state.get("clock", None)
        clock = torch.zeros_like(full) if clock is None else clock.to(full)
        anew = torch.ones_like(self._failed) if mask is None else mask
        column = anew[:, None]
        self._theta = torch.where(column, theta.to(full), self._theta)
        self._charge = torch.where(column, charge, self._charge)
        self._clock = torch.where(column, clock, self._clock)
        self._rate = torch.where(column, torch.zeros_like(full), self._rate)
        self._failed = self._failed & ~anew
        return self.state

    def step(self, inputs: TensorDictBase) -> TensorDict:
        """Let ``dt`` pass; the command (N, 1) is u, cut off at 0 and 1."""
        share = inputs.get("command").to(self._charge).clamp(0.0, 1.0)
        motion, camera = self._theta.split(1, dim=-1)
        after = (self._charge - self.dt / HOUR * (motion + share * camera)).clamp_min(0.0)
        self._failed = self._failed | ~after.isfinite().squeeze(-1)
        goes = ~self._failed[:, None]
        self._rate = torch.where(goes, (after - self._charge) * HOUR / self.dt, self._rate)
        self._charge = torch.where(goes, after, self._charge)
        self._clock = torch.where(goes, self._clock + self.dt, self._clock)
        return self.state

    def rollout(
        self,
        theta: Float[Tensor, "M P"],
        state: TensorDictBase,
        inputs: TensorDictBase,
        times: Float[Tensor, " T"],
    ) -> TensorDict:
        """Trajectories of M phones; see :meth:`Simulator.rollout`. A timestep is ``dt``."""
        return by_steps(self, theta, state, inputs, times)

    def with_effect(self, effect: Effect) -> Self:
        """Refused: the vocabulary is of machines.

        Raises:
            BadInput: always.
        """
        raise BadInput(f"{effect.key} has no form in a phone", "its parameters are the two currents")

    def with_worlds(self, worlds: int) -> Self:
        """Another number of phones, all nominal and full."""
        return type(self)(worlds, self.dt, self.capacity, self.device, self.dtype)
