"""The force stage: what effects without a native form add between the engine's timesteps, over all worlds at once.

    qfrc_applied = sum of forces(q, v, f, u, hidden),   dof_frictionloss = the model's + sum of friction bounds
    dof_armature, dof_M0 = the model's + sum of changes of inertia

The effects' equations are those that the torch backend uses. A force is held over the timestep, as an explicit method
does; dry friction is the bound of MuJoCo's own friction constraint, so that the solver makes it stick. The engine calls
nothing in Python: worlds with a force stage are stepped one timestep at a time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco.batch
import numpy as np
import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.simulators.effects import Effect, Seen
from onlinebayes.simulators.mujoco.actuation import FIELDS, JointActuator
from onlinebayes.simulators.mujoco.addresses import model_array
from onlinebayes.simulators.mujoco.system import MujocoSystem

INERTIA = ("dof_armature", "dof_M0")
"""What a change of a joint's inertia is written to; of a body on slides alone the engine reads nothing but dof_M0."""


@dataclass(frozen=True)
class Place:
    """Where one effect acts: columns of its joint in ``qpos`` and ``qvel``, and the actuators that it sees.

    Args:
        effect: the effect.
        q, v: columns.
        actuators: those whose force it sees; of an effect at an actuator, that one.
    """

    effect: Effect
    q: int
    v: int
    actuators: tuple[JointActuator, ...]

    @classmethod
    def of(cls, system: MujocoSystem, effect: Effect) -> Place:
        """The place of an effect; ``system`` has checked the target."""
        model = system.model
        actuators = system.joint_actuators
        if effect.target_kind == "actuator":
            mine = tuple(a for a in actuators if a.actuator == model.actuator(effect.target).id)
            joint = mine[0].joint
        else:
            joint = int(model.joint(effect.target).id)
            mine = tuple(a for a in actuators if a.joint == joint)
        return cls(effect, int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint]), mine)

    def see(
        self,
        fields: Mapping[str, Tensor],
        qpos: Float[Tensor, "*batch nq"],
        qvel: Float[Tensor, "*batch nv"],
        ctrl: Float[Tensor, "*batch nu"],
        on: Tensor,
        hidden: TensorDict | None,
        timestep: float,
    ) -> Seen:
        """What the effect sees there; fields and ``on`` as for :meth:`.JointActuator.force`."""
        q, v = qpos[..., self.q], qvel[..., self.v]
        drive, command = torch.zeros_like(q), torch.zeros_like(q)
        for actuator in self.actuators:
            command = command + ctrl[..., actuator.ctrl]
            if self.effect.needs_drive:
                force = actuator.force(fields, ctrl, q, v, on)
                whole = self.effect.target_kind == "joint"
                drive = drive + (force * actuator.gear(fields) if whole else force)
        servo = self.actuators[0].servo(fields, ctrl, q, v, on) if self.effect.needs_servo else None
        return Seen(q, v, drive, command, hidden, timestep, servo)


class ForceStage:
    """The force stage of N worlds on one batch.

    Args:
        system: the compiled system, with at least one staged effect.
        batch: whose ``qfrc_applied`` it sets.
        fields: the fields of the model that differ between worlds, live; it sets those of the joints.

    Attributes:
        hidden: key -> hidden state of each staged effect that has one; replace it to start from another.
    """

    def __init__(
        self, system: MujocoSystem, batch: mujoco.batch.Batch, fields: Mapping[str, np.ndarray], worlds: int
    ) -> None:
        self._system, self._timestep = system, float(system.model.opt.timestep)
        self._places = tuple(Place.of(system, effect) for effect in system.staged)
        self._q, self._v, self._ctrl, self._applied = (
            torch.from_numpy(batch.bind(name)) for name in ("qpos", "qvel", "ctrl", "qfrc_applied")
        )
        self._fields = actuator_fields(system, fields)
        self._loss = _JointField(
            "dof_frictionloss", fields, worlds, {place.v for place in self._places if place.effect.rubs}
        )
        weighed = {place.v for place in self._places if place.effect.weighs}
        self._inertia = [_JointField(name, fields, worlds, weighed) for name in INERTIA]
        self._theta = torch.zeros(worlds, len(system.parameters), dtype=torch.float64)
        self._own: dict[str, dict[str, Tensor]] = {}
        self.hidden: dict[str, TensorDict] = {}

    def write_theta(self, theta: np.ndarray, ids: np.ndarray | None) -> None:
        """Take the parameters theta (n, P) of the worlds ``ids``, whose fields have just been written."""
        rows = slice(None) if ids is None else torch.from_numpy(ids).long()
        self._theta[rows] = torch.from_numpy(theta)
        self._own = {place.effect.key: self._system.own(place.effect, self._theta) for place in self._places}

    def keep(self, ids: np.ndarray | None) -> None:
        """Take what stands in the joints' fields of the worlds ``ids``, constants included, as the model's own."""
        rows = slice(None) if ids is None else torch.from_numpy(ids).long()
        for field in (self._loss, *self._inertia):
            field.keep(rows)

    def apply(self, on: np.ndarray, alive: np.ndarray | None) -> None:
        """Set the forces and bounds of the timestep to come, and move the hidden states to its end.

        Args:
            on: which actuators are on (N, U).
            alive: the worlds that will be stepped (all without); the hidden states of the others stay.
        """
        switched = torch.from_numpy(on)
        push: dict[int, Tensor] = {}
        bounds: dict[int, Tensor] = {}
        weights: dict[int, Tensor] = {}
        for place in self._places:
            effect, own = place.effect, self._own[place.effect.key]
            seen = self._see(place, switched)
            force, after = effect.force(own, seen), effect.advance(own, seen)
            if force is not None and effect.target_kind == "actuator":
                force = force * place.actuators[0].gear(self._fields)
            _add(push, place.v, force)
            _add(bounds, place.v, effect.friction_bound(own, seen))
            _add(weights, place.v, effect.inertia(own, seen))
            if after is not None and seen.hidden is not None:
                self.hidden[effect.key] = after if alive is None else _keep(seen.hidden, after, alive)
        for dof, force in push.items():
            self._applied[:, dof] = force
        self._loss.raise_by(bounds)
        for field in self._inertia:
            field.raise_by(weights)

    def _see(self, place: Place, on: Tensor) -> Seen:
        hidden = self.hidden.get(place.effect.key)
        return place.see(self._fields, self._q, self._v, self._ctrl, on, hidden, self._timestep)


class _JointField:
    """A field of the joints' degrees of freedom that the stage sets on every timestep.

    Args:
        name: of the field.
        fields: live arrays, this one among them unless there are no columns.
        worlds: N.
        columns: which degrees of freedom.
    """

    def __init__(self, name: str, fields: Mapping[str, np.ndarray], worlds: int, columns: set[int]) -> None:
        self._columns = sorted(columns)
        self._live = torch.from_numpy(fields[name]) if columns else torch.zeros(worlds, 0, dtype=torch.float64)
        self._model = torch.zeros(worlds, len(columns), dtype=torch.float64)

    def keep(self, rows: slice | Tensor) -> None:
        """Take what stands there as the model's own."""
        self._model[rows] = self._live[rows][:, self._columns]

    def raise_by(self, more: Mapping[int, Tensor]) -> None:
        """Set the model's own plus this."""
        for k, dof in enumerate(self._columns):
            self._live[:, dof] = self._model[:, k] + more[dof]


def _add(sums: dict[int, Tensor], dof: int, part: Tensor | None) -> None:
    if part is not None:
        sums[dof] = sums[dof] + part if dof in sums else part


def actuator_fields(system: MujocoSystem, fields: Mapping[str, np.ndarray]) -> dict[str, Tensor]:
    """What the actuators' forces depend on, of N worlds where it differs between them, else of one; views of both."""
    return {
        name: torch.from_numpy(fields[name] if name in fields else model_array(system.model, name)[None].copy())
        for name in FIELDS
    }


def _keep(before: TensorDict, after: TensorDict, alive: np.ndarray) -> TensorDict:
    """``after`` in the worlds that are alive, ``before`` in the others."""
    rows = torch.from_numpy(alive).long()
    return before.apply(lambda a, b: a.index_copy(0, rows, b[rows]), after, batch_size=before.batch_size)
