"""Mechanical systems written as batched equations in torch: give the acceleration, get a simulator.

    a = M(q)^{-1} (f(q, v) + tau),    tau = gears u + effects

A subclass writes ``acceleration``; how a step follows from it stands in ``stepping``.
"""

from __future__ import annotations

import copy
import itertools
import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal, Self

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput, nearest
from onlinebayes.simulators.checks import refuse_twice, timesteps_of
from onlinebayes.simulators.effects import Effect, Scales, TargetKind
from onlinebayes.simulators.identifiable import Identifiable
from onlinebayes.simulators.stepping import DIVERGED, Actuator, Hidden, Integrator, Joint, Stepper, diverged


class TorchSimulator(Identifiable):
    """N worlds of one mechanical system given by its acceleration.

    A subclass states the class attributes and :meth:`acceleration`.

    Args:
        parameters: which of the system's parameters are free and their bounds, by name, in the order of theta; or just
            their names, with the bounds of :attr:`physical`. The others rest at :attr:`defaults`.
        worlds: number of worlds N.
        dt: seconds that one step advances [s], a whole number of :attr:`timestep`; one timestep without it.
        dtype, device: of all tensors.

    Attributes:
        physical: every parameter of the system with its physical bounds. Not a prior.
        defaults: name -> value of every parameter of the system.
        joints, actuators: by name, in the order of coordinates and commands.
        integrator: how a step follows from the acceleration; see ``stepping``.
        bodies: name -> (mass [kg], size [m]) of what effects of its own can act on.
        laws: effects of its own, which :meth:`acceleration` holds: it finds their parameters, neutral while they are
            not added, under their keys ``name@target.parameter``.

    Raises:
        BadInput: a parameter that the system does not have, or a ``dt`` that is no whole number of timesteps.
    """

    physical: ClassVar[ParameterSpace]
    defaults: ClassVar[Mapping[str, float]]
    joints: ClassVar[tuple[Joint, ...]]
    actuators: ClassVar[tuple[Actuator, ...]]
    integrator: ClassVar[Integrator] = "semi-implicit"
    bodies: ClassVar[Mapping[str, tuple[float, float]]] = {}
    laws: ClassVar[tuple[type[Effect], ...]] = ()
    _fixed: Mapping[str, float]
    _theta: Tensor
    _values: dict[str, Tensor]
    _q: Tensor
    _v: Tensor
    _hidden: Hidden
    _failed: Tensor
    _any_failed: bool

    def __init__(
        self,
        parameters: ParameterSpace | Sequence[str] = (),
        worlds: int = 1,
        *,
        dt: float | None = None,
        dtype: torch.dtype = torch.float64,
        device: torch.device | str = "cpu",
    ) -> None:
        if not isinstance(parameters, ParameterSpace):
            parameters = self.physical.subspace(parameters)
        for name in parameters:
            self.physical.index(name)
        self.parameters = parameters
        self.dt = self.timestep if dt is None else dt
        self._substeps = timesteps_of(self.dt, self.timestep)
        self.dtype, self.device = dtype, torch.empty(0, device=device).device  # "cuda" becomes "cuda:0"
        self.commands = tuple(a.name for a in self.actuators)
        self.signals = tuple(f"{kind}.{j.name}" for kind in ("qpos", "qvel") for j in self.joints)
        self.effects: tuple[Effect, ...] = ()
        self._populate(worlds)

    @abstractmethod
    def acceleration(
        self,
        parameters: Mapping[str, Float[Tensor, " N"]],
        q: Float[Tensor, "J N"],
        v: Float[Tensor, "J N"],
        tau: Float[Tensor, "J N"],
    ) -> Float[Tensor, "J N"]:
        """a = M(q)^{-1} (f(q, v) + tau), affine in tau [m/s^2, rad/s^2].

        Joints come first, so that each coordinate is one contiguous row and ``x, angle = q`` unpacks them.

        Args:
            parameters: every parameter of the system, free or not, and of its laws (N,) [SI].
            q: positions [m, rad].
            v: velocities [m/s, rad/s].
            tau: generalised forces of actuators and effects [N, N m].
        """

    @property
    def nominal(self) -> Float[Tensor, " P"]:
        """The defaults, and each effect's neutral values."""
        values = {f"{e.key}.{name}": value for e in self.effects for name, value in e.neutral.items()}
        return self.parameters.vector(
            {name: {**self.defaults, **values}[name] for name in self.parameters}, dtype=self.dtype, device=self.device
        )

    @property
    def state(self) -> TensorDict:
        """A copy of the complete state of all worlds."""
        return self._state(self._q, self._v, self._hidden)

    @property
    def joint_kinds(self) -> dict[str, Literal["slide", "hinge"]]:
        """Name -> kind of every joint, which decides the units of what acts on it."""
        return {joint.name: joint.kind for joint in self.joints}

    def targets(self, kind: TargetKind) -> tuple[str, ...]:
        """List the targets of one kind, by name; its bodies are there for its own laws."""
        return tuple(self.bodies) if kind == "body" else super().targets(kind)

    @property
    def body_sizes(self) -> Mapping[str, tuple[float, float]]:
        """Mass [kg] and size [m] of each body."""
        return self.bodies

    @property
    def own_effects(self) -> Mapping[str, type[Effect]]:
        """The laws by name."""
        return {law.name: law for law in self.laws}

    @property
    def theta(self) -> Float[Tensor, "N P"]:
        """A copy of every world's parameters."""
        return self._theta.T.clone(memory_format=torch.contiguous_format)

    @property
    def failed(self) -> Bool[Tensor, " N"]:
        """Worlds whose state left the finite or passed :data:`DIVERGED` since their last reset."""
        return self._failed.clone()

    def reset(
        self,
        theta: Float[Tensor, "N P"],
        state: TensorDictBase | None = None,
        mask: Bool[Tensor, " N"] | None = None,
    ) -> TensorDict:
        """New parameters and states for the worlds under ``mask``; see :meth:`Simulator.reset`."""
        if mask is None:
            self._theta = self._rows(theta)
            self._q, self._v, self._hidden = self._load_state(state, self.worlds)
            self._failed, self._any_failed = torch.zeros_like(self._failed), False
        else:
            # Only the rows that reset are moved: with thousands of worlds a few end in every step.
            mask = mask.to(self.device)
            rows = mask.nonzero().squeeze(-1)
            q, v, hidden = self._load_state(state, len(rows), rows)
            self._theta = self._theta.index_copy(1, rows, self._rows(theta.to(self.device)[rows]))
            self._q, self._v = self._q.index_copy(1, rows, q), self._v.index_copy(1, rows, v)
            self._hidden = {key: _put(self._hidden[key], rows, hidden[key]) for key in hidden}
            if self._any_failed:
                self._failed = self._failed & ~mask
                self._any_failed = bool(self._failed.any())
        self._values = self._name(self._theta)
        return self._state(self._q, self._v, self._hidden)

    def snapshot(self) -> dict[str, Any]:
        """Return the state of all worlds; see :meth:`Simulator.snapshot`."""
        hidden = {key: dict(value.flatten_keys(".").clone().items()) for key, value in self._hidden.items()}
        return {
            "theta": self._theta.clone(),
            "q": self._q.clone(),
            "v": self._v.clone(),
            "hidden": hidden,
            "failed": self._failed.clone(),
        }

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Stand where a snapshot was taken; see :meth:`Simulator.restore`."""
        self._theta, self._q, self._v, self._failed = (
            snapshot[key].to(self.device, copy=True) for key in ("theta", "q", "v", "failed")
        )
        self._hidden = {
            key: TensorDict(dict(value), batch_size=(self.worlds,), device=self.device).unflatten_keys(".").clone()
            for key, value in snapshot["hidden"].items()
        }
        self._any_failed = bool(self._failed.any())
        self._values = self._name(self._theta)

    def step(self, inputs: TensorDictBase) -> TensorDict:
        """Advance every world that has not failed by ``dt``."""
        command = inputs.get("command").to(dtype=self.dtype, device=self.device)
        q, v, hidden = self._stepper.advance(
            self._values, self._q, self._v, self._hidden, command, self._enable(inputs), self._substeps
        )
        if self._any_failed or not _settled(q, v):
            bad = self._failed | diverged(q, v)
            q, v = torch.where(bad, self._q, q), torch.where(bad, self._v, v)
            hidden = {key: _select(bad, self._hidden[key], hidden[key]) for key in hidden}
            self._failed, self._any_failed = bad, bool(bad.any())
        self._q, self._v, self._hidden = q, v, hidden
        return self._state(q, v, hidden)

    def rollout(
        self,
        theta: Float[Tensor, "M P"],
        state: TensorDictBase,
        inputs: TensorDictBase,
        times: Float[Tensor, " T"],
    ) -> TensorDict:
        """Trajectories of M worlds; see :meth:`Simulator.rollout`."""
        values = self._name(self._rows(theta))
        q, v, hidden = self._load_state(state, len(theta))
        command = inputs.get("command").to(dtype=self.dtype, device=self.device)
        enable = self._enable(inputs)
        marks = [0, *(times.double() / self.timestep).round().long().tolist()]
        valid = torch.ones(len(theta), dtype=torch.bool, device=self.device)
        all_valid, rows = True, []
        for k, steps in enumerate(b - a for a, b in itertools.pairwise(marks)):
            on = None if enable is None else enable[:, k]
            new_q, new_v, new_hidden = self._stepper.advance(values, q, v, hidden, command[:, k], on, steps)
            if not (all_valid and _settled(new_q, new_v)):
                valid = valid & ~diverged(new_q, new_v)
                all_valid = bool(valid.all())
                new_q, new_v = torch.where(valid, new_q, q), torch.where(valid, new_v, v)
                new_hidden = {key: _select(valid, new_hidden[key], hidden[key]) for key in new_hidden}
            q, v, hidden = new_q, new_v, new_hidden
            rows.append((q, v, hidden, valid))
        return self._recorded(rows)

    def hidden_states_along(
        self, theta: Float[Tensor, "N P"], motion: TensorDictBase, step: float
    ) -> dict[str, TensorDict]:
        """Hidden states of force stages along a known motion; see :meth:`Identifiable.hidden_states_along`."""
        q, v, command = (
            motion.get(key).to(dtype=self.dtype, device=self.device) for key in ("qpos", "qvel", "command")
        )
        values = self._name(self._rows(theta))
        return self._stepper.hidden_states_along(
            values, q.movedim(-1, 0), v.movedim(-1, 0), command, self._enable(motion), step
        )

    def read(self, state: TensorDictBase) -> Float[Tensor, "*batch S"]:
        """Positions, then velocities."""
        return torch.cat((state.get("qpos"), state.get("qvel")), dim=-1)

    def with_effect(self, effect: Effect) -> Self:
        """A new simulator with this effect; see :meth:`Simulator.with_effect`."""
        own = type(effect) in self.laws
        if effect.target_kind not in ("joint", "actuator", "signal", "parameter") and not own:
            raise BadInput(
                f"{effect.key} has no form in torch",
                "a torch system has joints, actuators and signals, and the laws that its equations hold",
            )
        if effect.needs_servo or effect.changes_inertia:
            raise BadInput(
                f"{effect.key} has no form in torch",
                "a torch system's actuators do not know their motion, and its inertia is in its equations",
            )
        known = self.targets(effect.target_kind)
        if effect.target not in known:
            problem = f"{effect.target_kind} '{effect.target}' of {effect.key} is unknown"
            raise BadInput(problem, nearest(effect.target, known))
        refuse_twice(effect, self.effects)
        outside = effect.target_kind in ("signal", "parameter")
        if not (own or effect.has_command or effect.has_force or outside):
            raise BadInput(f"{effect.key} has no form in torch", "write its force, friction_bound or command")
        grown = copy.copy(self)
        grown.effects = (*self.effects, effect)
        grown.parameters = self.parameters | ParameterSpace(
            {f"{effect.key}.{name}": parameter for name, parameter in effect.parameters.items()}
        )
        grown._populate(self.worlds)
        return grown

    def with_worlds(self, worlds: int) -> Self:
        """A new simulator with another number of worlds, all at the nominal parameters and at rest."""
        other = copy.copy(self)
        other._populate(worlds)
        return other

    def with_bounds(self, name: str, parameter: Parameter) -> Self:
        """A new simulator with other bounds for one parameter; see :meth:`Identifiable.with_bounds`."""
        other = copy.copy(self)
        other.parameters = self.parameters.replaced(name, parameter)
        other._populate(self.worlds)
        return other

    def with_timestep(self, timestep: float) -> Self:
        """A new simulator that integrates with another step; see :meth:`Identifiable.with_timestep`."""
        if not 0.0 < timestep < math.inf:
            raise BadInput(f"timestep = {timestep:g} s", "it must be positive and finite")
        other = copy.copy(self)
        other.timestep, other.dt, other._substeps = timestep, timestep, 1
        other._populate(self.worlds)
        return other

    def with_dt(self, dt: float) -> Self:
        """A new simulator whose step lasts ``dt`` seconds; see :meth:`Integrated.with_dt`."""
        other = copy.copy(self)
        other.dt, other._substeps = dt, timesteps_of(dt, self.timestep)
        other._populate(self.worlds)
        return other

    def _lawless(self) -> dict[str, float]:
        """Neutral values of the laws' parameters, under their keys."""
        some = Scales(force=1.0, speed=1.0, travel=1.0, time=1.0)
        effects = [law.scaled(target, some) for law in self.laws for target in self.targets(law.target_kind)]
        return {f"{effect.key}.{name}": value for effect in effects for name, value in effect.neutral.items()}

    # --- state --------------------------------------------------------------------------------------------------

    def _populate(self, worlds: int) -> None:
        """All worlds at the nominal parameters and at rest."""
        if worlds < 1:
            raise BadInput(f"worlds = {worlds}", "a simulator has at least one world")
        self.worlds = worlds
        self._stepper = Stepper(
            self.acceleration, self.joints, self.actuators, self.effects, self.timestep, self.integrator
        )
        self._fixed = {**self.defaults, **self._lawless()}
        self._theta = self.nominal[:, None].repeat(1, worlds)
        self._values = self._name(self._theta)
        self._q, self._v, self._hidden = self._load_state(None, worlds)
        self._failed = torch.zeros(worlds, dtype=torch.bool, device=self.device)
        self._any_failed = False  # known on the host, so that a step asks the device only once

    def _name(self, rows: Float[Tensor, "P N"]) -> dict[str, Float[Tensor, " N"]]:
        """Every parameter of the system and of its effects, those that are not free at their defaults."""
        values = self.parameters.view(rows.T)
        for name, value in self._fixed.items():
            if name not in values:
                values[name] = torch.full((rows.shape[1],), value, dtype=self.dtype, device=self.device)
        return values

    def _named(self, theta: Float[Tensor, " P"]) -> dict[str, Float[Tensor, ""]]:
        """Every parameter of one world by name, those that are not free at their defaults."""
        return {name: value[0] for name, value in self._name(self._rows(theta[None])).items()}

    def _enable(self, inputs: TensorDictBase) -> Tensor | None:
        """Return the mask of the actuators that are on; None for all."""
        enable = inputs.get("enable", None)
        return None if enable is None else enable.to(self.device)

    def _rows(self, columns: Float[Tensor, "N K"]) -> Float[Tensor, "K N"]:
        """A copy with one contiguous row a quantity, the layout in which worlds are kept."""
        columns = columns.to(dtype=self.dtype, device=self.device)
        return columns.T.clone(memory_format=torch.contiguous_format)

    def _state(self, q: Tensor, v: Tensor, hidden: Hidden) -> TensorDict:
        # Copies: what a caller does to a state does not reach the simulator.
        state = TensorDict({"qpos": q.clone().T, "qvel": v.clone().T}, batch_size=(q.shape[1],), device=self.device)
        for key, value in hidden.items():
            state["effects", key] = value.clone()
        return state

    def _recorded(self, rows: Sequence[tuple[Tensor, Tensor, Hidden, Tensor]]) -> TensorDict:
        """A rollout from its rows of positions, velocities, hidden states and validity; one TensorDict for all."""
        leaves = {
            "qpos": torch.stack([q.T for q, _, _, _ in rows], dim=1),
            "qvel": torch.stack([v.T for _, v, _, _ in rows], dim=1),
            "valid": torch.stack([valid for _, _, _, valid in rows], dim=1),
        }
        recorded = TensorDict(leaves, batch_size=leaves["valid"].shape, device=self.device)
        for key in rows[0][2]:
            recorded["effects", key] = TensorDict.stack([hidden[key] for _, _, hidden, _ in rows], dim=1)
        return recorded

    def _load_state(
        self, state: TensorDictBase | None, worlds: int, rows: Tensor | slice = slice(None)
    ) -> tuple[Tensor, Tensor, Hidden]:
        """Copies of the given rows of a state, ``worlds`` in number; what it lacks is at rest."""
        blank = torch.zeros(len(self.joints), worlds, dtype=self.dtype, device=self.device)
        hidden = {}
        for effect in self.effects:
            given = None if state is None else state.get(("effects", effect.key), None)
            given = effect.rest(worlds, self.timestep, blank[0]) if given is None else given[rows]
            if given is not None:
                hidden[effect.key] = given.to(self.device).clone()
        if state is None:
            return blank, blank.clone(), hidden
        return self._rows(state.get("qpos")[rows]), self._rows(state.get("qvel")[rows]), hidden


def _settled(q: Float[Tensor, "J N"], v: Float[Tensor, "J N"]) -> bool:
    """Check whether no world can have diverged: one reduction, which costs less than the masks."""
    return bool(q.abs().sum() + v.abs().sum() < DIVERGED)


def _put(into: TensorDict, rows: Tensor, values: TensorDict) -> TensorDict:
    """A copy of ``into`` with ``values`` in some rows."""
    return into.apply(lambda a, b: a.index_copy(0, rows, b), values, batch_size=into.batch_size)


def _select(mask: Tensor, yes: TensorDict, no: TensorDict) -> TensorDict:
    """Row by row: ``yes`` where the mask holds, else ``no``."""
    return yes.apply(lambda a, b: torch.where(mask.reshape(-1, *[1] * (a.ndim - 1)), a, b), no)
