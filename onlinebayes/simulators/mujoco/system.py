"""One compiled system with its effects: how theta becomes fields of the model, and which state makes it complete.

    fields = effects(parameters(base fields; theta); theta)

Which state that is stands in :mod:`.record`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.mujoco import pseudo_inertia
from onlinebayes.simulators.mujoco.actuation import JointActuator
from onlinebayes.simulators.mujoco.addresses import (
    Address,
    expand,
    is_glob,
    model_array,
    names,
    resolve,
)
from onlinebayes.simulators.mujoco.columns import Command, commands, signals
from onlinebayes.simulators.mujoco.host import to_host
from onlinebayes.simulators.mujoco.inertials import with_movable_centres
from onlinebayes.simulators.mujoco.model import compile_spec
from onlinebayes.simulators.mujoco.native import native, sticking
from onlinebayes.simulators.mujoco.record import record
from onlinebayes.simulators.mujoco.scaled_moments import INERTIA, follow, followers
from onlinebayes.simulators.mujoco.sensors import add_torque_sensors, sensor_places
from onlinebayes.simulators.mujoco.targets import check_staged, check_target


class MujocoSystem:
    """A model, its free parameters and its effects, compiled.

    Args:
        source: the spec without effects; not changed.
        parameters: the free parameters, by address.
        effects: in order.
        sensors: signals that sensors give, ``sensor.<name>`` or ``qfrc.<joint>``.
        soft_friction: leave the dry friction of effects as soft as the model's own is; see :mod:`.sticking`.
        scaled_moments: moments of inertia follow the free masses of their bodies; see :mod:`.scaled_moments`.
        members: globs among the parameters -> the addresses that they stand for; others are looked up in ``source``.

    Raises:
        BadInput: the model does not compile, an address or a target does not exist.
    """

    def __init__(
        self,
        source: mujoco.MjSpec,
        parameters: ParameterSpace,
        effects: Sequence[Effect] = (),
        sensors: Sequence[str] = (),
        soft_friction: bool = False,
        scaled_moments: bool = False,
        members: Mapping[str, tuple[str, ...]] | None = None,
    ) -> None:
        self.source, self.base_parameters, self.effects = source, parameters, tuple(effects)
        self.soft_friction, self.scaled_moments = soft_friction, scaled_moments
        #: The model without effects.
        self.base = base = compile_spec(source)
        known = members or {}
        self.members = {name: known.get(name) or expand(base, name) for name in parameters if is_glob(name)}
        self.spec = source.copy()
        self.parameters = parameters
        #: Key -> MuJoCo's own term, of the effects that have one.
        self.native = {e.key: term for e in self.effects if (term := native(e))}
        for effect in self.effects:
            check_target(base, effect, sensors, self.parameters)
            if term := self.native.get(effect.key):
                if clash := [address for address in term.excludes if address in parameters]:
                    problem = f"{effect.key} cannot stand beside a free {' or '.join(clash)}"
                    raise BadInput(problem, "leave one of them out")
                term.edit(self.spec, effect)
            self.parameters = self.parameters | _grown(effect)
        add_torque_sensors(self.spec, base, sensors)
        self.model = compile_spec(self.spec) if self.effects or sensors else base
        self.sensors, self.sensor_places = tuple(sensors), sensor_places(self.model, sensors)
        self.addresses: tuple[Address, ...] = tuple(
            resolve(self.model, name, self.members.get(name)) for name in parameters
        )
        cells = [(address.name, cell.array, cell.index) for address in self.addresses for cell in address.cells]
        inertials = pseudo_inertia.bodies(self.model, cells)
        self.model = with_movable_centres(self.spec, self.model, self._moved_centres(), inertials)
        self.commands = commands(self.model, names(base, "actuator"))
        self.signals = (*signals(self.model), *self.sensors)
        self.stages = tuple(e for e in self.effects if e.has_command and e.key not in self.native)
        self.staged = tuple(e for e in self.effects if e.has_force and e.key not in self.native)
        self.joint_actuators = _joint_actuators(self.model, self.commands)
        for effect in self.staged:
            check_staged(self.model, self.joint_actuators, effect)
        arrays = {c.array for a in self.addresses for c in a.cells}
        #: Bodies whose moments could follow their masses.
        self.followers = followers(self.model, [(array, index) for _, array, index in cells])
        if scaled_moments and self.followers:
            arrays |= {INERTIA}
        self._factors = {i: pseudo_inertia.factor(self.model, i) for i in inertials}
        self.fields = tuple(
            sorted(
                (arrays - {pseudo_inertia.ARRAY})
                | (set(pseudo_inertia.FIELDS) if self._factors else set())
                | {f for term in self.native.values() for f in term.fields}
                | {f for e in self.staged if e.bounds_friction for f in sticking.FIELDS}
                | {"dof_armature" for e in self.staged if e.changes_inertia}
            )
        )
        self._base = {name: model_array(self.model, name).copy() for name in {*self.fields, *arrays}}
        self._scatter = _scatter(self.addresses, self._base)
        self.needs_const = any(is_const_input(f) for f in self.fields)
        self._places = {command.name: command.ctrl for command in self.commands}
        self.record = record(self.model, bool(sensors))
        self.parts = tuple(self.record.columns)

    def _moved_centres(self) -> list[int]:
        """Ids of the bodies whose centre of mass a parameter or an effect moves."""
        cells = [cell for address in self.addresses for cell in address.cells if cell.array == "body_ipos"]
        effects = [e for e in self.effects if e.key in self.native and "body_ipos" in self.native[e.key].fields]
        rows = np.arange(self.model.nbody)
        own = [int(i) for cell in cells for i in np.atleast_1d(rows[cell.index[0]])]
        return [*own, *(int(self.model.body(effect.element).id) for effect in effects)]

    @property
    def nominal(self) -> Tensor:
        """The file's own values and the effects' neutral ones (P,)."""
        values = [address.read(self.model) for address in self.addresses]
        values += [value for effect in self.effects for value in _neutral(effect)]
        return torch.tensor(values, dtype=torch.float64)

    def own(self, effect: Effect, theta: np.ndarray | Tensor) -> dict:
        """The effect's own parameters by their short names, columns of theta (N,)."""
        return {name: theta[:, self.parameters.index(f"{effect.key}.{name}")] for name in effect.parameters}

    def write(self, theta: np.ndarray) -> dict[str, np.ndarray]:
        """Every field that a parameter or an effect touches, per world (N, ...), for theta (N, P)."""
        fields = {name: np.repeat(base[None], len(theta), axis=0) for name, base in self._base.items()}
        for name, (columns, sources, signs) in self._scatter.items():
            fields[name].reshape(len(theta), self._base[name].size)[:, columns] = signs * theta[:, sources]
        if self._factors:
            pseudo_inertia.write(fields, self._factors)
        if self.scaled_moments:
            follow(fields, self.followers, self.model)
        own = {name: fields[name].copy() for name in sticking.SOFTNESS if self.soft_friction and name in fields}
        for effect in self.effects:
            if term := self.native.get(effect.key):
                term.write(self.model, fields, effect, self.own(effect, theta))
        for effect in self.staged:
            if effect.bounds_friction:
                # Its bound is written between timesteps; here the solver is made ready where there may be one.
                values, neutral = self.own(effect, theta), effect.neutral
                acts = np.any([values[name] != neutral[name] for name in effect.parameters], axis=0)
                sticking.harden(self.model, fields, effect.target, acts)
        return fields | own

    def rest(self, worlds: int, timestep: float | None = None) -> dict[str, TensorDict]:
        """Hidden states of the command and force stages before anything has happened, for timesteps of this length."""
        like = torch.zeros((), dtype=torch.float64)
        effects = [e for e in self.effects if e in self.stages or e in self.staged]
        timestep = self.model.opt.timestep if timestep is None else timestep
        rests = {e.key: e.rest(worlds, timestep, like) for e in effects}
        return {key: rest for key, rest in rests.items() if rest is not None}

    def hidden(self, state: TensorDictBase | None, worlds: int) -> dict[str, TensorDict]:
        """Hidden states found in ``state``; what it lacks is at rest."""
        rest = self.rest(worlds)
        if state is None:
            return rest
        return {key: state.get(("effects", key), default).to(default.device) for key, default in rest.items()}

    def drive(
        self, theta: Tensor, hidden: Mapping[str, TensorDict], command: Tensor, timestep: float | None = None
    ) -> tuple[np.ndarray, dict[str, TensorDict], dict[str, Tensor]]:
        """Compute the inputs of the actuators over K timesteps.

        Args:
            theta: parameters (N, P).
            hidden: hidden states of the command stages before the first timestep.
            command: (N, K, U) [command units].
            timestep: length of one [s]; the model's when None.

        Returns:
            ``ctrl`` (N, K, nu), the hidden states after the last timestep, and what each stage was fed (N, K).
        """
        after, fed = dict(hidden), {}
        timestep = self.model.opt.timestep if timestep is None else timestep
        ctrl = np.zeros((*command.shape[:2], self.model.nu))
        ctrl[..., [place.ctrl for place in self.commands]] = to_host(command)
        for effect in self.stages:
            # An actuator has one command; stages on the same one act in their order.
            place = self._places[effect.target]
            u = torch.from_numpy(ctrl[..., place].copy())
            fed[effect.key] = u
            u, state = effect.command(self.own(effect, theta), hidden.get(effect.key), u, timestep)
            if state is not None:
                after[effect.key] = state
            ctrl[..., place] = to_host(u)
        return ctrl, after, fed

    def trace(
        self, theta: Tensor, hidden: Mapping[str, TensorDict], fed: Mapping[str, Tensor]
    ) -> dict[str, TensorDict]:
        """Hidden states after each timestep (N, K), from what :meth:`drive` fed the stages."""
        traces = {
            e.key: e.trace(self.own(e, theta), hidden.get(e.key), fed[e.key], self.model.opt.timestep)
            for e in self.stages
        }
        return {key: trace for key, trace in traces.items() if trace is not None}


def _scatter(
    addresses: Sequence[Address], base: Mapping[str, np.ndarray]
) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Per array: its flat columns that parameters set, each one's place in theta, and its sign."""
    places: dict[str, list[tuple[int, int, float]]] = {}
    for i, address in enumerate(addresses):
        for cell in address.cells:
            flat = np.arange(base[cell.array].size).reshape(base[cell.array].shape)
            columns = np.ravel(flat[cell.index]).tolist()
            for column, other, _ in places.get(cell.array, ()):
                if column in columns and other != i:
                    problem = f"'{addresses[other].name}' and '{address.name}' are the same value of the model"
                    raise BadInput(problem, "leave one of them out")
            places.setdefault(cell.array, []).extend((column, i, cell.sign) for column in columns)
    unzipped = {array: tuple(zip(*rows, strict=True)) for array, rows in places.items()}
    return {array: (np.array(c), np.array(s), np.array(signs)) for array, (c, s, signs) in unzipped.items()}


def is_const_input(field: str) -> bool:
    """Check whether constants that ``mj_setConst`` derives depend on this field."""
    return field.startswith("opt.") or field in mujoco.MjModel._setconst_inputs


def _neutral(effect: Effect) -> list[float]:
    return [effect.neutral[name] for name in effect.parameters]


def _grown(effect: Effect) -> ParameterSpace:
    return ParameterSpace({f"{effect.key}.{name}": parameter for name, parameter in effect.parameters.items()})


def _joint_actuators(model: mujoco.MjModel, commands: Sequence[Command]) -> tuple[JointActuator, ...]:
    """The model's own actuators that act on joints and take a single command."""
    found = [
        JointActuator.of(model, c.actuator, column, c.ctrl)
        for column, c in enumerate(commands)
        if model.actuator_ctrlnum[c.actuator] == 1
    ]
    return tuple(actuator for actuator in found if actuator is not None)
