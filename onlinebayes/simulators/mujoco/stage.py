"""The force stage: what effects without a native form add between the engine's timesteps, over all worlds at once.

    qfrc_applied = sum of forces(q, v, f, u, hidden),   dof_frictionloss = the model's + sum of friction bounds
    dof_armature, dof_M0 = the model's + sum of changes of inertia

The effects' equations are those that the torch backend uses. f is that of the model's actuators with what effects at
them add, so that friction under a load feels the force that there is. Dry friction is the bound of MuJoCo's own
friction constraint, so that the solver makes it stick. The engine calls nothing in Python: worlds with a force stage
are stepped one timestep at a time, and a force is held over it. Methods of first order take it at the
timestep's start. Under Runge and Kutta's that alone would make the step one of first order: there laws without memory
are taken at its middle,

    q_m = q + h/2 v,    v_m = v + h/2 a(q, v, forces at the start)

which leaves an error of h^2 (the explicit midpoint rule; Hairer, Norsett and Wanner 1993, II.1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
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
"""The fields that hold a change of a joint's inertia; of a body on slides alone the engine reads nothing but dof_M0."""


@dataclass(frozen=True)
class Place:
    """The place where one effect acts: columns of its joint in ``qpos`` and ``qvel``, and the actuators that it sees.

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
        """Return the effect's inputs at that place; fields and ``on`` as for :meth:`.JointActuator.force`."""
        q, v = qpos[..., self.q], qvel[..., self.v]
        drive, command = torch.zeros_like(q), torch.zeros_like(q)
        for actuator in self.actuators:
            command = command + ctrl[..., actuator.ctrl]
            if self.effect.needs_drive:
                force = actuator.force(fields, ctrl, q, v, on)
                whole = self.effect.target_kind == "joint"
                drive = drive + (force * actuator.gear(fields) if whole else force)
        servo = None
        if self.effect.needs_servo:
            servo = self.actuators[0].servo(fields, ctrl, q, v, on, whole=self.effect.target_kind == "joint")
        return Seen(q, v, drive, command, hidden, timestep, servo)


class ForceStage:
    """The force stage of N worlds on one batch.

    Args:
        system: the compiled system, with at least one staged effect.
        batch: whose ``qfrc_applied`` it sets.
        fields: the fields of the model that differ between worlds, live; it sets those of the joints.

    Attributes:
        hidden: key -> hidden state of each staged effect that has one; replace it to start from another.
        halves: whether :meth:`apply_halfway` is to follow :meth:`apply`.
    """

    def __init__(
        self, system: MujocoSystem, batch: mujoco.batch.Batch, fields: Mapping[str, np.ndarray], worlds: int
    ) -> None:
        self._system, self._timestep = system, float(system.model.opt.timestep)
        # What effects at actuators add is in the drive that those at joints see.
        at_actuators_first = sorted(system.staged, key=lambda effect: effect.target_kind != "actuator")
        self._places = tuple(Place.of(system, effect) for effect in at_actuators_first)
        self._q, self._v, self._ctrl, self._applied = (
            torch.from_numpy(batch.bind(name)) for name in ("qpos", "qvel", "ctrl", "qfrc_applied")
        )
        self._fields = actuator_fields(system, fields)
        self._loss = _JointField(
            "dof_frictionloss", fields, worlds, {place.v for place in self._places if place.effect.bounds_friction}
        )
        weighed = {place.v for place in self._places if place.effect.changes_inertia}
        self._inertia = [_JointField(name, fields, worlds, weighed) for name in INERTIA]
        self._theta = torch.zeros(worlds, len(system.parameters), dtype=torch.float64)
        self._own: dict[str, dict[str, Tensor]] = {}
        self._switched = torch.ones(worlds, 0, dtype=torch.bool)
        self._begun: list[_Acting] = []
        runge_kutta = system.model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
        self._memoryless = [k for k, place in enumerate(self._places) if not place.effect.remembers]
        self.halves = runge_kutta and bool(self._memoryless)
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
        """Set the forces and bounds at the start of the timestep to come, and move the hidden states to its end.

        Args:
            on: which actuators are on (N, U).
            alive: the worlds that will be stepped (all without); the hidden states of the others stay.
        """
        self._switched, self._begun = torch.from_numpy(on), []
        for place in self._places:
            seen = self._see(place, self._q, self._v, self._begun)
            self._begun.append(self._acting(place, seen))
            after = place.effect.advance(self._own[place.effect.key], seen)
            if after is not None and seen.hidden is not None:
                self.hidden[place.effect.key] = after if alive is None else _keep(seen.hidden, after, alive)
        self._set(self._begun)

    def apply_halfway(self, acceleration: Float[Tensor, "N nv"]) -> None:
        """After :meth:`apply`: the forces and bounds of laws without memory anew, at the middle of the timestep.

        Args:
            acceleration: at the timestep's start, under the forces set there.
        """
        half = 0.5 * self._timestep
        q, v = self._q.clone(), self._v + half * acceleration
        for place in self._places:
            q[:, place.q] = self._q[:, place.q] + half * self._v[:, place.v]
        acting = list(self._begun)
        for k in self._memoryless:
            acting[k] = self._acting(self._places[k], self._see(self._places[k], q, v, acting))
        self._set(acting)

    def _acting(self, place: Place, seen: Seen) -> _Acting:
        effect, own = place.effect, self._own[place.effect.key]
        force = effect.force(own, seen)
        if force is not None and effect.target_kind == "actuator":
            force = force * place.actuators[0].gear(self._fields)
        return _Acting(force, effect.friction_bound(own, seen), effect.inertia(own, seen))

    def _set(self, acting: Sequence[_Acting]) -> None:
        """Write what all effects do together where the engine reads it."""
        push: dict[int, Tensor] = {}
        bounds: dict[int, Tensor] = {}
        weights: dict[int, Tensor] = {}
        for place, one in zip(self._places, acting, strict=True):
            _add(push, place.v, one.force)
            _add(bounds, place.v, one.bound)
            _add(weights, place.v, one.inertia)
        for dof, force in push.items():
            self._applied[:, dof] = force
        self._loss.raise_by(bounds)
        for field in self._inertia:
            field.raise_by(weights)

    def _see(self, place: Place, q: Float[Tensor, "N nq"], v: Float[Tensor, "N nv"], acting: Sequence[_Acting]) -> Seen:
        hidden = self.hidden.get(place.effect.key)
        seen = place.see(self._fields, q, v, self._ctrl, self._switched, hidden, self._timestep)
        if place.effect.target_kind != "joint" or not place.effect.needs_drive:
            return seen
        for other, one in zip(self._places, acting, strict=False):  # those that have acted by now
            if other.effect.target_kind == "actuator" and other.v == place.v and one.force is not None:
                seen = replace(seen, drive=seen.drive + one.force)
        return seen


@dataclass(frozen=True)
class _Acting:
    """The action of one effect over a timestep: force, bound of dry friction, change of inertia, each (N,) or None."""

    force: Tensor | None
    bound: Tensor | None
    inertia: Tensor | None


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
    """Return the fields behind the actuators' forces, of N worlds where they differ, else of one; views of both."""
    return {
        name: torch.from_numpy(fields[name] if name in fields else model_array(system.model, name)[None].copy())
        for name in FIELDS
    }


def _keep(before: TensorDict, after: TensorDict, alive: np.ndarray) -> TensorDict:
    """``after`` in the worlds that are alive, ``before`` in the others."""
    rows = torch.from_numpy(alive).long()
    return before.apply(lambda a, b: a.index_copy(0, rows, b[rows]), after, batch_size=before.batch_size)
