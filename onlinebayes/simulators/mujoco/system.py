"""One compiled system with its effects: how theta becomes fields of the model, and which state makes it complete.

    fields = effects(parameters(base fields; theta); theta)

| part of the state     | shape   | there when                                                       |
|-----------------------|---------|------------------------------------------------------------------|
| ``"qpos"``, ``"qvel"`` | nq, nv | always                                                           |
| ``"act"``             | na      | actuators have activations                                       |
| ``"history"``, ``"time"`` | n, 1 | the model file itself has delays                                 |
| ``"qacc_warmstart"``  | nv      | always: the constraint solver starts from it, so the future depends on it |
| ``"ctrl"``            | nu      | sensors are signals: those of forces feel the command that is held |
| ``"sensor"``          | n       | sensors are signals (see :mod:`.sensors`); read, never set       |
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
import torch
from jaxtyping import Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput, nearest
from onlinebayes.simulators.effects import Effect, sticking
from onlinebayes.simulators.effects.contact import touching
from onlinebayes.simulators.mujoco import pseudo_inertia
from onlinebayes.simulators.mujoco.actuation import JointActuator
from onlinebayes.simulators.mujoco.addresses import (
    HINGE,
    SLIDE,
    Address,
    element_id,
    model_array,
    movable_body,
    movable_site,
    names,
    resolve,
    scalar_joint,
)
from onlinebayes.simulators.mujoco.inertials import with_movable_centres
from onlinebayes.simulators.mujoco.model import compile_spec
from onlinebayes.simulators.mujoco.scaled_moments import INERTIA, follow, followers
from onlinebayes.simulators.mujoco.sensors import add_torque_sensors, sensor_places

STATE = {
    "time": mujoco.mjtState.mjSTATE_TIME,
    "qpos": mujoco.mjtState.mjSTATE_QPOS,
    "qvel": mujoco.mjtState.mjSTATE_QVEL,
    "act": mujoco.mjtState.mjSTATE_ACT,
    "history": mujoco.mjtState.mjSTATE_HISTORY,
    "qacc_warmstart": mujoco.mjtState.mjSTATE_WARMSTART,
}


@dataclass(frozen=True)
class Record:
    """Layout of one recorded row: which parts of the state, where, and MuJoCo's bits for it; time comes first.

    Args:
        bits: the ``mjtState`` bits of all parts.
        columns: key of the state -> its columns.
        size: width S of a row.
    """

    bits: int
    columns: dict[str, slice]
    size: int

    def unpack(self, rows: Float[Tensor, "*batch S"]) -> dict[str, Tensor]:
        """The parts of a state, sharing the rows' memory."""
        return {key: rows[..., columns] for key, columns in self.columns.items()}

    def pack(self, state: TensorDictBase, worlds: int) -> np.ndarray:
        """Rows (N, S) of a state; time 0."""
        rows = np.zeros((worlds, self.size))
        for key, columns in self.columns.items():
            rows[:, columns] = state.get(key).numpy()
        return rows


@dataclass(frozen=True)
class Command:
    """One command column: its name, its actuator's id and its place in ``ctrl``."""

    name: str
    actuator: int
    ctrl: int


class MujocoSystem:
    """A model, its free parameters and its effects, compiled.

    Args:
        source: the spec without effects; not changed.
        parameters: the free parameters, by address.
        effects: in order.
        sensors: signals that sensors give, ``sensor.<name>`` or ``qfrc.<joint>``.
        soft_friction: leave the dry friction of effects as soft as the model's own is; see :mod:`.sticking`.
        scaled_moments: moments of inertia follow the free masses of their bodies; see :mod:`.scaled_moments`.

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
    ) -> None:
        self.source, self.base_parameters, self.effects = source, parameters, tuple(effects)
        self.soft_friction, self.scaled_moments = soft_friction, scaled_moments
        base = compile_spec(source)
        self.spec = source.copy()
        self.parameters = parameters
        for effect in self.effects:
            _check_target(base, effect, sensors, self.parameters)
            if clash := [address for address in effect.excludes if address in parameters]:
                raise BadInput(f"{effect.key} cannot stand beside a free {' or '.join(clash)}", "leave one of them out")
            effect.edit(self.spec)
            self.parameters = self.parameters | _grown(effect)
        add_torque_sensors(self.spec, base, sensors)
        self.model = compile_spec(self.spec) if self.effects or sensors else base
        self.sensors, self.sensor_places = tuple(sensors), sensor_places(self.model, sensors)
        self.addresses: tuple[Address, ...] = tuple(resolve(self.model, name) for name in parameters)
        cells = [(address.name, cell.array, cell.index) for address in self.addresses for cell in address.cells]
        inertials = pseudo_inertia.bodies(self.model, cells)
        self.model = with_movable_centres(self.spec, self.model, self._moved_centres(), inertials)
        self.commands = _commands(self.model, names(base, "actuator"))
        self.signals = (*_signals(self.model), *self.sensors)
        self.stages = tuple(e for e in self.effects if e.has_command and not e.fields)
        self.staged = tuple(e for e in self.effects if e.staged)
        self.joint_actuators = _joint_actuators(self.model, self.commands)
        for effect in self.staged:
            _check_staged(self.model, self.joint_actuators, effect)
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
                | {f for e in self.effects for f in e.fields}
                | {f for e in self.staged if e.bounds_friction for f in sticking.FIELDS}
                | {"dof_armature" for e in self.staged if e.changes_inertia}
            )
        )
        self._base = {name: model_array(self.model, name).copy() for name in {*self.fields, *arrays}}
        self._scatter = _scatter(self.addresses, self._base)
        self.needs_const = any(is_const_input(f) for f in self.fields)
        self._places = {command.name: command.ctrl for command in self.commands}
        self.record = _record(self.model, bool(sensors))
        self.parts = tuple(self.record.columns)

    def _moved_centres(self) -> list[int]:
        """Ids of the bodies whose centre of mass a parameter or an effect moves."""
        cells = [cell for address in self.addresses for cell in address.cells if cell.array == "body_ipos"]
        effects = [effect for effect in self.effects if "body_ipos" in effect.fields]
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
            if effect.fields:
                effect.write(self.model, fields, self.own(effect, theta))
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
        return {key: state.get(("effects", key), default) for key, default in rest.items()}

    def drive(
        self, theta: Tensor, hidden: Mapping[str, TensorDict], command: Tensor, timestep: float | None = None
    ) -> tuple[np.ndarray, dict[str, TensorDict], dict[str, Tensor]]:
        """What the actuators receive over K timesteps.

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
        ctrl[..., [place.ctrl for place in self.commands]] = command.numpy()
        for effect in self.stages:
            # An actuator has one command; stages on the same one act in their order.
            place = self._places[effect.target]
            u = torch.from_numpy(ctrl[..., place].copy())
            fed[effect.key] = u
            u, state = effect.command(self.own(effect, theta), hidden.get(effect.key), u, timestep)
            if state is not None:
                after[effect.key] = state
            ctrl[..., place] = u.numpy()
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
    """Whether constants that ``mj_setConst`` derives depend on this field."""
    return field.startswith("opt.") or field in mujoco.MjModel._setconst_inputs


def _record(model: mujoco.MjModel, sensors: bool) -> Record:
    # Time matters only to delays, which read their buffers by it; the record always has it, to see who stopped.
    columns, place, bits = {}, 0, 0
    # Sensors of forces depend on the command that is held, which the future does not.
    parts = {**STATE, "ctrl": mujoco.mjtState.mjSTATE_CTRL} if sensors else STATE
    for key, bit in parts.items():
        size = mujoco.mj_stateSize(model, int(bit))
        if key in ("qpos", "qvel") or size > 0:
            bits |= int(bit)
            if key != "time" or model.nhistory:
                columns[key] = slice(place, place + size)
            place += size
    return Record(bits, columns, place)


def _neutral(effect: Effect) -> list[float]:
    return [effect.neutral[name] for name in effect.parameters]


def _grown(effect: Effect) -> ParameterSpace:
    return ParameterSpace({f"{effect.key}.{name}": parameter for name, parameter in effect.parameters.items()})


def _check_target(model: mujoco.MjModel, effect: Effect, sensors: Sequence[str], parameters: ParameterSpace) -> None:
    if "world" in effect.wider and effect.element == "world":
        pass
    elif effect.target_kind == "joint":
        scalar_joint(model, effect.target)
    elif effect.target_kind in ("signal", "parameter"):
        known = (*_signals(model), *sensors) if effect.target_kind == "signal" else parameters.names
        if effect.target not in known:
            problem = f"{effect.target_kind} '{effect.target}' of {effect.key} is unknown"
            raise BadInput(problem, nearest(effect.target, known))
        return
    elif effect.target_kind == "body":
        at_site = "site" in effect.wider and effect.element not in names(model, "body")
        (movable_site if at_site and effect.element in names(model, "site") else movable_body)(model, effect.element)
    elif effect.target_kind == "geom":
        touching(model, effect.target)
    elif effect.target_kind == "world":
        if effect.element != "world":
            raise BadInput(f"{effect.key} acts on the whole world", f"write {effect.name}@world")
    else:
        actuator = element_id(model, "actuator", effect.target)
        if effect.has_command and not effect.fields and model.actuator_ctrlnum[actuator] != 1:
            raise BadInput(f"{effect.key}: the actuator has several commands", "an input stage acts on a single one")
    if not (effect.fields or effect.has_command or effect.has_force):
        raise BadInput(
            f"{effect.key} has no form in MuJoCo", "write its fields and write(), its command(), or its force()"
        )


def _check_staged(model: mujoco.MjModel, actuators: Sequence[JointActuator], effect: Effect) -> None:
    if effect.target_kind == "actuator":
        mine = [a for a in actuators if a.actuator == model.actuator(effect.target).id]
        if not mine or int(model.jnt_type[mine[0].joint]) not in (int(SLIDE), int(HINGE)):
            raise BadInput(f"{effect.key}: the actuator drives no slide or hinge joint", "use an actuator of a joint")
        if effect.bounds_friction:
            raise BadInput(f"{effect.key}: dry friction acts on a joint", "give it a joint as target")
    else:
        mine = [a for a in actuators if a.joint == model.joint(effect.target).id]
    if effect.needs_drive:
        for actuator in mine:
            actuator.check(model, effect.key)
    if effect.needs_servo:
        if len(mine) != 1:
            raise BadInput(f"{effect.key}: joint '{effect.target}' has {len(mine)} actuators", "it needs a single one")
        mine[0].check(model, effect.key)


def _joint_actuators(model: mujoco.MjModel, commands: Sequence[Command]) -> tuple[JointActuator, ...]:
    """The model's own actuators that act on joints and take a single command."""
    found = [
        JointActuator.of(model, c.actuator, column, c.ctrl)
        for column, c in enumerate(commands)
        if model.actuator_ctrlnum[c.actuator] == 1
    ]
    return tuple(actuator for actuator in found if actuator is not None)


def _commands(model: mujoco.MjModel, visible: Sequence[str]) -> tuple[Command, ...]:
    """The commands of the model's own actuators; actuators that effects added have none."""
    columns = []
    for name in visible:
        i = model.actuator(name).id
        first, count = int(model.actuator_ctrladr[i]), int(model.actuator_ctrlnum[i])
        for k in range(count):
            columns.append(Command(name if count == 1 else f"{name}.{k}", i, first + k))
    return tuple(columns)


def _signals(model: mujoco.MjModel) -> tuple[str, ...]:
    """``qpos.<joint>`` of all joints, then ``qvel.<joint>``; with .0 ... where a joint has several."""
    widths = {mujoco.mjtJoint.mjJNT_FREE: (7, 6), mujoco.mjtJoint.mjJNT_BALL: (4, 3)}
    signals = []
    for part, key in enumerate(("qpos", "qvel")):
        for i, name in enumerate(names(model, "joint")):
            width = widths.get(mujoco.mjtJoint(model.jnt_type[i]), (1, 1))[part]
            signals += [f"{key}.{name}"] if width == 1 else [f"{key}.{name}.{k}" for k in range(width)]
    return tuple(signals)
