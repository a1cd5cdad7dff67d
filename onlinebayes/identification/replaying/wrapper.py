"""A simulator around another one, to which it forwards: criticism sees its parameters or positions in another form."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Self, TypeVar

from jaxtyping import Bool, Float
from tensordict import TensorDictBase
from torch import Tensor

from onlinebayes.parameters import Parameter
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.effects import Contact, Effect
from onlinebayes.simulators.identifiable import Identifiable


class SimulatorWrapper(Identifiable):
    """A simulator whose worlds are those of another one.

    Args:
        inner: the other one.

    Attributes:
        physics: the other one.
    """

    def __init__(self, inner: Identifiable) -> None:
        self.physics = inner
        self.worlds, self.dt, self.timestep = inner.worlds, inner.dt, inner.timestep
        self.commands, self.effects = inner.commands, inner.effects
        self.device, self.dtype = inner.device, inner.dtype

    @abstractmethod
    def around(self, inner: Identifiable) -> Self:
        """The same around another simulator."""

    @property
    def nominal(self) -> Float[Tensor, " P"]:
        """Those of the physics."""
        return self.physics.nominal

    @property
    def theta(self) -> Float[Tensor, "N P"]:
        """A copy of every world's parameters."""
        return self.physics.theta

    def command_driven_states(
        self, theta: Float[Tensor, "N P"], command: Float[Tensor, "N K U"], step: float
    ) -> dict[str, Float[Tensor, "N K1 n"]]:
        """See :meth:`Identifiable.command_driven_states`."""
        return self.physics.command_driven_states(theta, command, step)

    @property
    def own_effects(self) -> Mapping[str, type[Effect]]:
        """Those of the physics."""
        return self.physics.own_effects

    @property
    def own_numbers(self) -> Mapping[str, Parameter]:
        """Those of the physics."""
        return self.physics.own_numbers

    def with_free(self, name: str, parameter: Parameter) -> Self:
        """See :meth:`Identifiable.with_free`."""
        return self.around(self.physics.with_free(name, parameter))

    @property
    def body_sizes(self) -> Mapping[str, tuple[float, float]]:
        """Those of the physics."""
        return self.physics.body_sizes

    @property
    def moving_joints(self) -> Mapping[str, tuple[str, ...]]:
        """Those of the physics."""
        return self.physics.moving_joints

    @property
    def servos(self) -> Mapping[str, tuple[str, ...]]:
        """Those of the physics."""
        return self.physics.servos

    @property
    def contacts(self) -> Mapping[str, Contact]:
        """Those of the physics."""
        return self.physics.contacts

    @property
    def fed_by_command(self) -> frozenset[str]:
        """Those of the physics."""
        return self.physics.fed_by_command

    @property
    def failed(self) -> Bool[Tensor, " N"]:
        """Worlds that diverged since their last reset."""
        return self.physics.failed

    @property
    def memory_span(self) -> float:
        """The memory span of the physics."""
        return self.physics.memory_span

    @property
    def integrating_commands(self) -> tuple[str, ...]:
        """Those of the physics."""
        return self.physics.integrating_commands

    def project_onto_constraints(self, state: TensorDictBase) -> TensorDictBase:
        """See :meth:`Identifiable.project_onto_constraints`."""
        return self.physics.project_onto_constraints(state)

    def constrained_positions(self, path: Float[Tensor, "T J"], known: Sequence[int]) -> Float[Tensor, "T J"]:
        """See :meth:`Identifiable.constrained_positions`."""
        return self.physics.constrained_positions(path, known)

    def with_rigid_constraints(self) -> Self:
        """See :meth:`Identifiable.with_rigid_constraints`."""
        other = self.physics.with_rigid_constraints()
        return self if other is self.physics else self.around(other)

    def with_effect(self, effect: Effect) -> Self:
        """See :meth:`Simulator.with_effect`."""
        return self.around(self.physics.with_effect(effect))

    def with_worlds(self, worlds: int) -> Self:
        """See :meth:`Simulator.with_worlds`."""
        return self.around(self.physics.with_worlds(worlds))

    def with_timestep(self, timestep: float) -> Self:
        """See :meth:`Identifiable.with_timestep`."""
        return self.around(self.physics.with_timestep(timestep))

    def with_dt(self, dt: float) -> Self:
        """See :meth:`Integrated.with_dt`."""
        return self.around(self.physics.with_dt(dt))

    def with_runge_kutta(self) -> Self:
        """See :meth:`Identifiable.with_runge_kutta`."""
        other = self.physics.with_runge_kutta()
        return self if other is self.physics else self.around(other)

    def with_first_order(self) -> Self:
        """See :meth:`Identifiable.with_first_order`."""
        other = self.physics.with_first_order()
        return self if other is self.physics else self.around(other)

    def with_soft_friction(self) -> Self:
        """See :meth:`Identifiable.with_soft_friction`."""
        other = self.physics.with_soft_friction()
        return self if other is self.physics else self.around(other)

    def with_scaled_moments(self) -> Self:
        """See :meth:`Identifiable.with_scaled_moments`."""
        other = self.physics.with_scaled_moments()
        return self if other is self.physics else self.around(other)

    def with_gravity_compensation(self) -> SimulatorWrapper | None:
        """See :meth:`Identifiable.with_gravity_compensation`."""
        other = self.physics.with_gravity_compensation()
        return None if other is None else self.around(other)

    def with_payload(self, body: str, mass: float) -> Self:
        """See :meth:`Identifiable.with_payload`."""
        return self.around(self.physics.with_payload(body, mass))


S = TypeVar("S", bound=Simulator)


def unwrap(simulator: S) -> S | Identifiable:
    """The simulator that others are around; itself where none is."""
    inner: S | Identifiable = simulator
    while isinstance(inner, SimulatorWrapper):
        inner = inner.physics
    return inner
