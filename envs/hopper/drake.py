"""Gymnasium's hopper in Drake, a second physics engine behind the same :class:`Simulator`.

    (q, v)_{k+1} = four discrete updates of 2 ms of ``MultibodyPlant``,   q and v in MuJoCo's order and convention

theta has MuJoCo's addresses, so one :class:`ParameterSpace` serves both engines. Needs the extra ``robotics``; see
:mod:`envs.hopper.drake_plant` for what is written where.
"""

from __future__ import annotations

from typing import Self

import numpy as np
import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from envs.hopper.drake_plant import TIMESTEP, DrakePlant
from envs.hopper.physics import DT
from envs.hopper.standard import STANDARD, standard_hopper
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Simulator
from onlinebayes.simulators.by_steps import by_steps
from onlinebayes.simulators.checks import timesteps_of
from onlinebayes.simulators.effects import Effect


class DrakeHopper(Simulator):
    """N hoppers in Drake, commanded every 8 ms, stepped one after the other on one core.

    Args:
        parameters: the free ones, by MuJoCo's addresses; others are as in Gymnasium's file, friction 2.0.
        worlds: number of worlds N.

    Raises:
        BadInput: Drake is not installed, or an address has no meaning in it.
    """

    def __init__(self, parameters: ParameterSpace = STANDARD, worlds: int = 1) -> None:
        self._build(DrakePlant(), parameters, worlds)

    def _build(self, plant: DrakePlant, parameters: ParameterSpace, worlds: int) -> None:
        self.parameters, self.worlds, self.dt = parameters, worlds, DT
        self.device, self.dtype = torch.device("cpu"), torch.float64
        self._plant, self._steps = plant, timesteps_of(DT, TIMESTEP)
        self._write = plant.writers(parameters.names)
        self._nominal = standard_hopper(parameters, threads=1).nominal
        if worlds < 1:
            raise BadInput(f"worlds = {worlds}", "a simulator has at least one world")
        self._worlds = [plant.world() for _ in range(worlds)]
        self._theta = torch.full((worlds, len(parameters)), torch.nan, dtype=self.dtype)
        self._failed = np.zeros(worlds, dtype=bool)
        self.reset(self.nominal.expand(worlds, -1))

    @property
    def nominal(self) -> Float[Tensor, " P"]:
        """The values that MuJoCo reads in the same file; of the friction, the floor's."""
        return self._nominal.clone()

    @property
    def state(self) -> TensorDict:
        """``"qpos"`` and ``"qvel"`` (N, 6)."""
        read = [self._plant.read(world) for world in self._worlds]
        qpos, qvel = (torch.from_numpy(np.stack(parts)) for parts in zip(*read, strict=True))
        return TensorDict({"qpos": qpos, "qvel": qvel}, batch_size=(self.worlds,))

    @property
    def theta(self) -> Float[Tensor, "N P"]:
        """A copy of every world's parameters."""
        return self._theta.clone()

    @property
    def failed(self) -> Bool[Tensor, " N"]:
        """Worlds in which Drake's contact solver gave up, or a value was not finite."""
        return torch.from_numpy(self._failed.copy())

    def reset(
        self,
        theta: Float[Tensor, "N P"],
        state: TensorDictBase | None = None,
        mask: Bool[Tensor, " N"] | None = None,
    ) -> TensorDict:
        """New parameters and states for the worlds under ``mask``; upright and at rest without a state."""
        rows = range(self.worlds) if mask is None else mask.nonzero()[:, 0].tolist()
        if not bool(theta[list(rows)].isfinite().all()):
            raise BadInput("theta is not finite", "give every parameter a finite value")
        theta = theta.detach().to(self.device, self.dtype)
        for i in rows:
            self._set(i, theta[i])
            if state is None:
                self._plant.place(self._worlds[i], *self._plant.read(self._plant.rest))
            else:
                self._plant.place(self._worlds[i], *(state.get(k)[i].double().cpu().numpy() for k in ("qpos", "qvel")))
            self._failed[i] = False
        return self.state

    def step(self, inputs: TensorDictBase) -> TensorDict:
        """Advance every world that has not failed by ``dt``."""
        command, enable = inputs.get("command"), inputs.get("enable", None)
        command = command if enable is None else command * enable
        for i, row in enumerate(command.detach().double().cpu().numpy()):
            if not self._failed[i]:
                self._failed[i] = not self._plant.advance(self._worlds[i], row, self._steps)
        return self.state

    def rollout(
        self,
        theta: Float[Tensor, "M P"],
        state: TensorDictBase,
        inputs: TensorDictBase,
        times: Float[Tensor, " T"],
    ) -> TensorDict:
        """See :meth:`Simulator.rollout`; times are whole multiples of ``dt``."""
        return by_steps(self, theta, state, inputs, times)

    def with_effect(self, effect: Effect) -> Self:
        """Refused."""
        raise BadInput(
            f"Drake's hopper cannot take '{effect.key}'",
            "add the effect to MuJoCo's, envs.hopper.standard_hopper, and let Drake play the real system",
        )

    def with_worlds(self, worlds: int) -> Self:
        """The same with another number of worlds; both share one diagram."""
        other = object.__new__(type(self))
        other._build(self._plant, self.parameters, worlds)
        return other

    def _set(self, i: int, theta: Float[Tensor, " P"]) -> None:
        """Write what differs."""
        for column in (theta != self._theta[i]).nonzero()[:, 0].tolist():
            self._write[column](self._worlds[i], float(theta[column]))
        self._theta[i] = theta
