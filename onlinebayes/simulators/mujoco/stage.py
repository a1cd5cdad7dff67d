"""The force stage: what effects without a native form add between the engine's timesteps, over all worlds at once.

    qfrc_applied = sum of forces(q, v, f, u, hidden),   dof_frictionloss = the model's + sum of friction bounds

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
        batch: whose ``qfrc_applied`` and ``dof_frictionloss`` it sets.
        fields: the fields of the model that differ between worlds, live.

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
        self._rubbing = sorted({place.v for place in self._places if place.effect.rubs})
        self._loss = torch.from_numpy(fields["dof_frictionloss"]) if self._rubbing else None
        self._base = torch.zeros(worlds, len(self._rubbing), dtype=torch.float64)
        self._theta = torch.zeros(worlds, len(system.parameters), dtype=torch.float64)
        self._own: dict[str, dict[str, Tensor]] = {}
        self.hidden: dict[str, TensorDict] = {}

    def write_theta(self, theta: np.ndarray, ids: np.ndarray | None) -> None:
        """Take the parameters theta (n, P) of the worlds ``ids``, whose fields have just been written."""
        rows = slice(None) if ids is None else torch.from_numpy(ids).long()
        self._theta[rows] = torch.from_numpy(theta)
        self._own = {place.effect.key: self._system.own(place.effect, self._theta) for place in self._places}
        if self._loss is not None:
            self._base[rows] = self._loss[rows][:, self._rubbing]

    def apply(self, on: np.ndarray, alive: np.ndarray | None) -> None:
        """Set the forces and bounds of the timestep to come, and move the hidden states to its end.

        Args:
            on: which actuators are on (N, U).
            alive: the worlds that will be stepped (all without); the hidden states of the others stay.
        """
        switched = torch.from_numpy(on)
        push: dict[int, Tensor] = {}
        bounds: dict[int, Tensor] = {}
        for place in self._places:
            effect, own = place.effect, self._own[place.effect.key]
            seen = self._see(place, switched)
            force, bound, after = effect.force(own, seen), effect.friction_bound(own, seen), effect.advance(own, seen)
            if force is not None:
                if effect.target_kind == "actuator":
                    force = force * place.actuators[0].gear(self._fields)
                push[place.v] = push[place.v] + force if place.v in push else force
            if bound is not None:
                bounds[place.v] = bounds[place.v] + bound if place.v in bounds else bound
            if after is not None and seen.hidden is not None:
                self.hidden[effect.key] = after if alive is None else _keep(seen.hidden, after, alive)
        for dof, force in push.items():
            self._applied[:, dof] = force
        if self._loss is not None:
            for k, dof in enumerate(self._rubbing):
                self._loss[:, dof] = self._base[:, k] + bounds[dof]

    def _see(self, place: Place, on: Tensor) -> Seen:
        hidden = self.hidden.get(place.effect.key)
        return place.see(self._fields, self._q, self._v, self._ctrl, on, hidden, self._timestep)


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
