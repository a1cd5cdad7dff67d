"""The simulator interface: many worlds at once, each with its own physical parameters. Physics only, no reward.

    state_{k+1} = f(theta, state_k, inputs_k),   one step of ``dt`` seconds

The state is complete: from a state and the inputs that follow, the future is determined. Hidden states of effects
(delay buffers) stand in it under ``("effects", key)``.

| key of a state        | shape        | meaning                                            |
|-----------------------|--------------|----------------------------------------------------|
| ``"qpos"``            | (N, nq)      | joint positions [m, rad]                           |
| ``"qvel"``            | (N, nv)      | joint velocities [m/s, rad/s]                      |
| ``("effects", key)``  | (N, ...)     | hidden state of the effect ``key``, where it has one |
| ``"sensor"``          | (N, n)       | what sensors that are signals read there; ignored on input |
| others                | (N, ...)     | what else the system remembers (MuJoCo: ``act``), optional on input |

Inputs are a TensorDict: ``"command"`` (N, U), and optionally ``"enable"``
(N, U), 0 while an actuator is off.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Self

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.parameters import ParameterSpace

if TYPE_CHECKING:
    from onlinebayes.simulators.effects import Effect


class Simulator(ABC):
    """N worlds of one system, stepped together.

    Learning asks for no more than this; a second physics engine is these methods. What identification and criticism ask
    besides stands in :class:`~onlinebayes.simulators.Identifiable`, what exact checkpoints ask in
    :class:`~onlinebayes.simulators.snapshots.Resumable`.

    Attributes:
        parameters: the space of theta; grows with :meth:`with_effect`.
        worlds: number of worlds N.
        dt: seconds that one :meth:`step` advances [s]; the command is held over it.
        device, dtype: of every tensor that goes in or out.
    """

    parameters: ParameterSpace
    worlds: int
    dt: float
    device: torch.device
    dtype: torch.dtype

    @property
    @abstractmethod
    def nominal(self) -> Float[Tensor, " P"]:
        """Theta of the system as it was built: the model file's own values, and neutral ones for effects."""

    @property
    @abstractmethod
    def state(self) -> TensorDict:
        """A copy of the complete state of all worlds, batch size (N,)."""

    @property
    @abstractmethod
    def theta(self) -> Float[Tensor, "N P"]:
        """A copy of every world's parameters."""

    @property
    @abstractmethod
    def failed(self) -> Bool[Tensor, " N"]:
        """Worlds that diverged since their last reset; they keep their last finite state and are not stepped."""

    @abstractmethod
    def reset(
        self,
        theta: Float[Tensor, "N P"],
        state: TensorDictBase | None = None,
        mask: Bool[Tensor, " N"] | None = None,
    ) -> TensorDict:
        """Give the worlds under ``mask`` (all without one) new parameters and a new state.

        Args:
            theta: parameters of all worlds (rows outside the mask are ignored) [SI].
            state: state of all worlds, or None for the system's default; hidden states of effects that it lacks
                start at rest.
            mask: the worlds to reset.

        Returns:
            The complete state of all worlds after the reset.
        """

    @abstractmethod
    def step(self, inputs: TensorDictBase) -> TensorDict:
        """Advance every world that has not failed by ``dt`` and return the complete state of all."""

    @abstractmethod
    def rollout(
        self,
        theta: Float[Tensor, "M P"],
        state: TensorDictBase,
        inputs: TensorDictBase,
        times: Float[Tensor, " T"],
    ) -> TensorDict:
        """Trajectories of M worlds from given states under given inputs; leaves the worlds of :meth:`step` alone.

        Args:
            theta: parameters (M, P); M is free, it need not be ``worlds``.
            state: complete states, batch size (M,).
            inputs: batch size (M, T); row k holds from ``times[k-1]`` (0 for the first) to ``times[k]``.
            times: instants since ``state`` at which states are recorded [s], increasing, each rounded to the nearest
                whole number of timesteps (integration steps) since the start.

        Returns:
            TensorDict of batch size (M, T): the keys of a state after each row, and ``"valid"`` (M, T), False from the
            row on in which a world diverged (its state is held there).
        """

    @abstractmethod
    def with_effect(self, effect: Effect) -> Self:
        """A new simulator with this effect added; its parameters follow the present ones as ``key.parameter``.

        Raises:
            BadInput: the target does not exist, the effect is already there, or this simulator cannot carry it.
        """

    @abstractmethod
    def with_worlds(self, worlds: int) -> Self:
        """A new simulator with another number of worlds."""
