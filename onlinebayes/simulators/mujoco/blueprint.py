"""The parts that a simulator of a model is built from, and its variants: the same anew with some parts replaced."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import mujoco
from jaxtyping import Float
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.abilities import InFile
from onlinebayes.simulators.checks import refuse_twice
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.identifiable import Identifiable
from onlinebayes.simulators.mujoco.addresses import written_out
from onlinebayes.simulators.mujoco.beside import beside
from onlinebayes.simulators.mujoco.closure import rigid
from onlinebayes.simulators.mujoco.in_file import in_file
from onlinebayes.simulators.mujoco.model import compile_spec
from onlinebayes.simulators.mujoco.own_numbers import own_numbers
from onlinebayes.simulators.mujoco.packing import packed, unpacked
from onlinebayes.simulators.mujoco.sensors import measured_sensors
from onlinebayes.simulators.mujoco.system import MujocoSystem
from onlinebayes.simulators.mujoco.variants import gravity_compensated, laden, with_option
from onlinebayes.simulators.mujoco.wrenches import with_wrenches
from onlinebayes.simulators.standalone import Setup

RK4 = mujoco.mjtIntegrator.mjINT_RK4


@dataclass(frozen=True)
class Blueprint:
    """The arguments of :class:`.MujocoSimulator`, under its names; it says what they are.

    ``model`` is the spec without effects, and ``dt`` a number in every case.
    """

    model: mujoco.MjSpec
    parameters: ParameterSpace
    worlds: int
    dt: float
    threads: int
    effects: tuple[Effect, ...]
    sensors: tuple[str, ...]
    soft_friction: bool
    scaled_moments: bool
    members: Mapping[str, tuple[str, ...]]


class Remakable(Identifiable):
    """A simulator made from a blueprint, and from another one for every variant of it.

    Attributes:
        model: the compiled model.
    """

    model: mujoco.MjModel
    _blueprint: Blueprint
    _system: MujocoSystem

    @abstractmethod
    def snapshot(self) -> dict[str, Any]:
        """Return the state of all worlds; see :class:`~onlinebayes.simulators.snapshots.Resumable`."""

    @abstractmethod
    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Stand where a snapshot was taken."""

    def with_effect(self, effect: Effect) -> Self:
        """A new simulator with this effect; see :meth:`Simulator.with_effect`."""
        refuse_twice(effect, self.effects)
        return self._remade(effects=(*self.effects, effect))

    def with_worlds(self, worlds: int) -> Self:
        """A new simulator with another number of worlds, all nominal and at the default state."""
        return self._remade(worlds=worlds)

    @property
    def own_numbers(self) -> dict[str, Parameter]:
        """See :mod:`.own_numbers`; without those that are parameters already."""
        base, members = self._system.base, self._system.members  # what effects add has numbers in their parameters
        named = [one for name in self._blueprint.parameters for one in members.get(name, (name,))]
        free = {one.removesuffix("[0]") for name in named for one in written_out(base, name)}
        return {name: p for name, p in own_numbers(base).items() if name.removesuffix("[0]") not in free}

    def with_free(self, name: str, parameter: Parameter) -> Self:
        """A new simulator with one parameter more, after the model's others; see :meth:`Identifiable.with_free`."""
        if name in self._blueprint.parameters:
            raise BadInput(f"'{name}' is a parameter already", "give it other bounds with with_bounds")
        return self._remade(parameters=ParameterSpace({**self._blueprint.parameters, name: parameter}))

    def with_bounds(self, name: str, parameter: Parameter) -> Self:
        """A new simulator with other bounds for one of the model's parameters; see :meth:`Identifiable.with_bounds`."""
        return self._remade(parameters=self._blueprint.parameters.replaced(name, parameter))

    def with_timestep(self, timestep: float) -> Self:
        """A new simulator that integrates with another step; see :meth:`Identifiable.with_timestep`."""
        return self._remade(model=with_option(self._blueprint.model, "timestep", timestep), dt=timestep)

    def with_dt(self, dt: float) -> Self:
        """A new simulator whose step lasts ``dt`` seconds; see :meth:`Integrated.with_dt`."""
        return self._remade(dt=dt)

    def with_runge_kutta(self) -> Self:
        """A new simulator with MuJoCo's RK4; see :meth:`Identifiable.with_runge_kutta`."""
        if self.model.opt.integrator == RK4:
            return self
        return self._integrated(RK4)

    def with_first_order(self) -> Self:
        """A new simulator with MuJoCo's implicitfast in place of RK4; see :meth:`Identifiable.with_first_order`.

        Implicit in what damps, it bears the steps that RK4 does.
        """
        if self.model.opt.integrator != RK4:
            return self
        return self._integrated(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)

    def with_soft_friction(self) -> Self:
        """A new simulator whose effects' friction is the model's own constraint; see :mod:`.native.sticking`.

        Itself where friction is no native effect, or where force stages have some, which no MJCF could hold.
        """
        native = any("dof_frictionloss" in term.fields for term in self._system.native.values())
        if self._blueprint.soft_friction or not native or any(effect.bounds_friction for effect in self._system.staged):
            return self
        return self._remade(soft_friction=True)

    def with_scaled_moments(self) -> Self:
        """A new simulator whose moments follow its free masses; itself where no such body turns."""
        if self._blueprint.scaled_moments or not self._system.followers:
            return self
        return self._remade(scaled_moments=True)

    def with_rigid_constraints(self) -> Self:
        """See :meth:`Identifiable.with_rigid_constraints`, and :func:`.closure.rigid`."""
        source = rigid(self._blueprint.model)
        return self if source is None else self._remade(model=source)

    def with_gravity_compensation(self) -> Remakable | None:
        """See :meth:`Identifiable.with_gravity_compensation`, and :func:`.variants.gravity_compensated`."""
        source = gravity_compensated(self._blueprint.model, self.model)
        return None if source is None else self._remade(model=source)

    def with_payload(self, body: str, mass: float) -> Self:
        """A new simulator with a point mass at a body's centre of mass; see :meth:`Identifiable.with_payload`."""
        return self._remade(model=laden(self._blueprint.model, self.model, body, mass))

    def with_columns(self, columns: Collection[str]) -> Self:
        """A new simulator with what a log's columns need: motors for measured wrenches, sensors as signals.

        Args:
            columns: of the log, others among them: ``xfrc.<body>.k``, ``qfrc.<joint>``, ``sensor.<name>``.
        """
        source = with_wrenches(self._blueprint.model, columns)
        wanted = {*columns, *self._blueprint.sensors}
        sensors = measured_sensors(compile_spec(source.copy()), wanted)
        if source is self._blueprint.model and set(sensors) == set(self._blueprint.sensors):
            return self
        return self._remade(model=source, sensors=tuple(sensors))

    def in_file(self, theta: Float[Tensor, " P"]) -> InFile:
        """One world as MJCF holds it; see :mod:`.in_file`."""
        return in_file(self, theta)

    def beside_file(
        self, theta: Float[Tensor, " P"], spec: mujoco.MjSpec, lacking: Collection[str]
    ) -> tuple[Setup, dict[str, str]]:
        """Laws and numbers that a file lacks, and keys of effects that cannot be laws -> why; see :mod:`.beside`.

        Args:
            theta: of the world.
            spec: of the file.
            lacking: keys of the effects that it does not hold.
        """
        return beside(self._system, theta, spec, tuple(lacking))

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """A simulator of its own that stands where this one does."""
        copied = self._remade()
        copied.restore(self.snapshot())
        return copied

    def __reduce__(self) -> tuple[Any, ...]:
        """For processes of their own: the model as text with its files, the other arguments, and where it stands."""
        arguments = {**vars(self._blueprint), "model": packed(self._blueprint.model)}
        return _remake, (type(self), arguments, self.snapshot())

    def _integrated(self, integrator: mujoco.mjtIntegrator) -> Self:
        return self._remade(model=with_option(self._blueprint.model, "integrator", integrator))

    def _remade(self, **changes: Any) -> Self:
        """This simulator anew, with what is given in place of its own; see :class:`.Blueprint`."""
        return type(self)(**vars(replace(self._blueprint, **changes)))


def _remake(kind: type[Remakable], arguments: dict[str, Any], snapshot: dict[str, Any]) -> Remakable:
    """The simulator that was taken apart for a pickle."""
    made = kind(**{**arguments, "model": unpacked(arguments["model"])})
    made.restore(snapshot)
    return made
