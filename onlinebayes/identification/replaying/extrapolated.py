"""A simulator whose replays are extrapolated from two steps: second order from a method of first order.

    x(t) = 2 x_{h/2}(t) - x_h(t) + O(h^2)                              (Richardson 1911; Hairer, Norsett, Wanner, II.9)

What is stiff, as a servo whose damping is large beside the inertia that it moves, is integrated stably by implicit
methods of first order alone: the error of a replay falls by half with each half step, and Runge's and Kutta's method
diverges. Where the motion is smooth, three evaluations of a step mostly err less than sixteen of its sixteenths.

The extrapolation is made in :func:`.replay.rollout`, where both replays begin from the same start. Everything else
meets the physics in steps of h.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Literal, Self, TypeVar

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.identification.replaying.wrapper import SimulatorWrapper
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.abilities import InFile, Integrated
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.effects import TargetKind
from onlinebayes.simulators.identifiable import Identifiable

S = TypeVar("S", bound=Integrated)

PARTS = 2
"""Of a step, in the finer of the two replays."""


class ExtrapolatedSimulator(SimulatorWrapper):
    """The worlds of ``physics``, marked to be replayed in two steps.

    Args:
        physics: integrated by a method of first order in steps of h.
    """

    def __init__(self, physics: Identifiable) -> None:
        super().__init__(physics)
        self.parameters, self.signals = physics.parameters, physics.signals

    @cached_property
    def finer(self) -> Identifiable:
        """The physics in steps of half the length."""
        return self.physics.with_timestep(self.physics.timestep / PARTS)

    def around(self, inner: Identifiable) -> Self:
        """Another physics, replayed in the same way."""
        return type(self)(inner)

    # --- a simulator: the physics itself ------------------------------------------------------------------------

    @property
    def joint_kinds(self) -> Mapping[str, Literal["slide", "hinge"]]:
        """Those of the physics."""
        return self.physics.joint_kinds

    def targets(self, kind: TargetKind) -> tuple[str, ...]:
        """Those of the physics."""
        return self.physics.targets(kind)

    @property
    def state(self) -> TensorDict:
        """A copy of the complete state of all worlds."""
        return self.physics.state

    def reset(
        self, theta: Float[Tensor, "N P"], state: TensorDictBase | None = None, mask: Bool[Tensor, " N"] | None = None
    ) -> TensorDict:
        """See :meth:`Simulator.reset`."""
        return self.physics.reset(theta, state, mask)

    def step(self, inputs: TensorDictBase) -> TensorDict:
        """One step of h; see :meth:`Simulator.step`."""
        return self.physics.step(inputs)

    def rollout(
        self, theta: Float[Tensor, "M P"], state: TensorDictBase, inputs: TensorDictBase, times: Float[Tensor, " T"]
    ) -> TensorDict:
        """In steps of h; see :meth:`Simulator.rollout`."""
        return self.physics.rollout(theta, state, inputs, times)

    def hidden_states_along(
        self, theta: Float[Tensor, "N P"], motion: TensorDictBase, step: float
    ) -> dict[str, TensorDict]:
        """See :meth:`Identifiable.hidden_states_along`."""
        return self.physics.hidden_states_along(theta, motion, step)

    def actuator_forces(
        self, theta: Float[Tensor, "N P"], motion: TensorDictBase, step: float
    ) -> Float[Tensor, "N K U"]:
        """See :meth:`Identifiable.actuator_forces`."""
        return self.physics.actuator_forces(theta, motion, step)

    def in_file(self, theta: Float[Tensor, " P"]) -> InFile | None:
        """See :meth:`Identifiable.in_file`."""
        return self.physics.in_file(theta)

    def read(self, state: TensorDictBase) -> Float[Tensor, "*batch S"]:
        """See :meth:`Identifiable.read`."""
        return self.physics.read(state)

    def with_bounds(self, name: str, parameter: Parameter) -> Self:
        """See :meth:`Identifiable.with_bounds`."""
        return self.around(self.physics.with_bounds(name, parameter))


def in_two_steps(simulator: S) -> S:
    """The simulator replayed in two steps; below whatever is around its physics."""
    if isinstance(simulator, SimulatorWrapper):
        return simulator.around(in_two_steps(simulator.physics))
    return ExtrapolatedSimulator(simulator)  # type: ignore[arg-type, return-value]


def in_one_step(simulator: Identifiable) -> Identifiable:
    """The simulator replayed in steps of h alone; itself where it is already."""
    if isinstance(simulator, ExtrapolatedSimulator):
        return simulator.physics
    if not isinstance(simulator, SimulatorWrapper):
        return simulator
    below = in_one_step(simulator.physics)
    return simulator if below is simulator.physics else simulator.around(below)


def coarse_and_fine(simulator: Identifiable) -> tuple[Identifiable, Identifiable] | None:
    """The simulator in steps of h and of half of it; None where it is replayed in one."""
    if isinstance(simulator, ExtrapolatedSimulator):
        return simulator.physics, simulator.finer
    below = coarse_and_fine(simulator.physics) if isinstance(simulator, SimulatorWrapper) else None
    if below is None:
        return None
    assert isinstance(simulator, SimulatorWrapper)
    return simulator.around(below[0]), simulator.around(below[1])


def replayed_in_two_steps(simulator: Simulator) -> bool:
    """Check whether replays of the simulator are extrapolated."""
    inner = simulator
    while isinstance(inner, SimulatorWrapper) and not isinstance(inner, ExtrapolatedSimulator):
        inner = inner.physics
    return isinstance(inner, ExtrapolatedSimulator)


def extrapolated(coarse: TensorDict, fine: TensorDict) -> TensorDict:
    """The trajectory that steps of no length would give; valid where both are, hidden states as in the finer one."""
    found = fine.clone(recurse=False)
    for key in ("qpos", "qvel", "sensor"):
        if key in fine.keys():  # noqa: SIM118  (iterating gives rows)
            found[key] = torch.lerp(coarse[key], fine[key], float(PARTS))
    found["valid"] = coarse["valid"] & fine["valid"]
    return found
