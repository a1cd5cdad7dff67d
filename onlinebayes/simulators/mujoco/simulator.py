"""Worlds of any MJCF model on ``mujoco.batch``, each with its own physical parameters and effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.checks import timesteps_of
from onlinebayes.simulators.drawing import Shape
from onlinebayes.simulators.effects import Contact, Effect, TargetKind
from onlinebayes.simulators.mujoco import drawing, inventory
from onlinebayes.simulators.mujoco.activation import activations, memory_span
from onlinebayes.simulators.mujoco.blueprint import Blueprint, Remakable
from onlinebayes.simulators.mujoco.closure import Closure, soft, tied
from onlinebayes.simulators.mujoco.export import bodies_with_adjusted_inertia, export, to_xml
from onlinebayes.simulators.mujoco.foreign import not_exportable
from onlinebayes.simulators.mujoco.host import to_host
from onlinebayes.simulators.mujoco.model import load_spec
from onlinebayes.simulators.mujoco.native.contacts import contacts
from onlinebayes.simulators.mujoco.pictures import Renderer
from onlinebayes.simulators.mujoco.recall import actuator_forces, hidden_states_along
from onlinebayes.simulators.mujoco.rollout import rollout
from onlinebayes.simulators.mujoco.system import MujocoSystem
from onlinebayes.simulators.mujoco.worlds import Worlds
from onlinebayes.simulators.mujoco.wrenches import is_wrench


class MujocoSimulator(Remakable):
    """N worlds of one MJCF model, bit for bit what ``mj_step`` gives over N models whose fields were changed.

    Args:
        model: path of an MJCF file, MJCF text, or a spec.
        parameters: the free parameters by address, e.g. ``"joint.hinge.damping"`` (see :mod:`.addresses`).
        worlds: number of worlds N.
        dt: seconds of a step [s], a whole number of the model's timesteps; one timestep without it.
        threads: threads that step the worlds, 0 for all cores. Give torch one (``torch.set_num_threads(1)``): its idle
            threads spin, and a Collector of 1024 hoppers on two cores was slower by a fifth for it.
        effects: effects to begin with, in order; the same as :meth:`with_effect` for each.
        sensors: sensors that are signals too, ``sensor.<name>`` or ``qfrc.<joint>`` (see :mod:`.sensors`).
        soft_friction: leave the dry friction of effects as soft as the model's own is, in place of one that sticks.
        scaled_moments: moments of inertia follow the free masses of their bodies (see :mod:`.scaled_moments`).
        members: globs among the parameters -> the addresses that they stand for; others are looked up in ``model``.

    Attributes:
        spec: the model's spec, effects' structure included; its values are the nominal ones.
        model: the compiled model.

    Raises:
        BadInput: the model is missing or does not compile, an address does not exist, ``dt`` is no whole number of
            timesteps.
    """

    def __init__(
        self,
        model: str | Path | mujoco.MjSpec,
        parameters: ParameterSpace | None = None,
        worlds: int = 1,
        dt: float | None = None,
        threads: int = 0,
        effects: Sequence[Effect] = (),
        sensors: Sequence[str] = (),
        soft_friction: bool = False,
        scaled_moments: bool = False,
        members: Mapping[str, tuple[str, ...]] | None = None,
    ) -> None:
        source, parameters = load_spec(model), parameters or ParameterSpace()
        self._system = MujocoSystem(source, parameters, effects, sensors, soft_friction, scaled_moments, members)
        self.spec, self.model = self._system.spec, self._system.model
        self.parameters, self.effects = self._system.parameters, self._system.effects
        self.commands = tuple(c.name for c in self._system.commands)
        self.signals = self._system.signals
        self.worlds, self.device, self.dtype = worlds, torch.device("cpu"), torch.float64
        self.timestep = float(self.model.opt.timestep)
        if not self.timestep > 0:
            raise BadInput(f"the model's timestep is {self.timestep:g} s", "give <option timestep> a positive time")
        self.dt = self.timestep if dt is None else dt
        self._steps = timesteps_of(self.dt, self.timestep)
        if worlds < 1:
            raise BadInput(f"worlds = {worlds}", "a simulator has at least one world")
        own, read = self._system.effects, self._system.sensors
        self._blueprint = Blueprint(
            source,
            parameters,
            worlds,
            self.dt,
            threads,
            own,
            read,
            soft_friction,
            scaled_moments,
            self._system.members,
        )
        self._worlds = Worlds(self._system, worlds, threads)
        self._closure = Closure(self.model) if tied(self.model) else None
        self._theta = self.nominal.expand(worlds, -1).clone()
        self._hidden = self._system.rest(worlds)
        self._worlds.write_theta(to_host(self._theta))
        self._renderers: dict[tuple[int, int], Renderer] = {}

    @property
    def nominal(self) -> Float[Tensor, " P"]:
        """The model file's own values, and the effects' neutral ones."""
        return self._system.nominal

    @property
    def state(self) -> TensorDict:
        """A copy of the complete state; see :mod:`.system` for its keys."""
        state = self._worlds.read_state()
        for key, hidden in self._hidden.items():
            state["effects", key] = hidden.clone()
        return state

    @property
    def joint_kinds(self) -> dict[str, Literal["slide", "hinge"]]:
        """Name -> kind of every slide and hinge joint, which decides the units of what acts on it."""
        return inventory.joint_kinds(self.model)

    def targets(self, kind: TargetKind) -> tuple[str, ...]:
        """See :meth:`Identifiable.targets`.

        Actuators, but no measured wrenches; slide and hinge joints, bodies that move and their sites, by name, geoms
        that can touch something and bodies with such geoms, and the world.
        """
        if kind == "actuator":
            return tuple(name for name in self.commands if not is_wrench(name))
        if kind == "joint":
            return tuple(self.joint_kinds)
        if kind == "body":
            return tuple(self.body_sizes)
        if kind == "geom":
            return tuple(self.contacts)
        if kind == "site":
            return inventory.moving_sites(self.model)
        return ("world",) if kind == "world" else super().targets(kind)

    @property
    def body_sizes(self) -> dict[str, tuple[float, float]]:
        """Mass [kg] of each named body that moves, and half the diagonal of the box with its inertia [m]."""
        return inventory.body_sizes(self.model)

    @property
    def moving_joints(self) -> dict[str, tuple[str, ...]]:
        """Names of the joints between the world and each of :attr:`body_sizes`."""
        return inventory.moving_joints(self.model)

    @property
    def fed_by_command(self) -> frozenset[str]:
        """Activations, where every actuator's are a filter's, an integrator's or a muscle's."""
        return inventory.fed_by_command(self.model)

    @property
    def servos(self) -> dict[str, tuple[str, ...]]:
        """Joints with actuators whose bias pulls against their position -> these actuators."""
        return inventory.servos(self._system)

    @property
    def contacts(self) -> dict[str, Contact]:
        """See :meth:`Identifiable.contacts`."""
        return contacts(self.model)

    @property
    def theta(self) -> Float[Tensor, "N P"]:
        """A copy of every world's parameters."""
        return self._theta.clone()

    @property
    def failed(self) -> Bool[Tensor, " N"]:
        """Worlds that the engine warned about since their last reset."""
        return torch.from_numpy(self._worlds.failed.copy())

    def reset(
        self,
        theta: Float[Tensor, "N P"],
        state: TensorDictBase | None = None,
        mask: Bool[Tensor, " N"] | None = None,
    ) -> TensorDict:
        """New parameters and states for the worlds under ``mask``; see :meth:`Simulator.reset`."""
        ids = None if mask is None or bool(mask.all()) else to_host(mask).nonzero()[0].astype(np.int32)
        if ids is not None and not len(ids):
            return self.state
        rows = slice(None) if ids is None else torch.from_numpy(ids).long()
        self._theta[rows] = _finite(theta[rows])
        for key, fresh in self._system.hidden(state, self.worlds).items():
            self._hidden[key][rows] = fresh[rows]
        self._worlds.revive(ids)
        self._worlds.write_theta(to_host(self._theta[rows]), ids)
        self._worlds.write_state(state, ids)
        return self.state

    def snapshot(self) -> dict[str, Any]:
        """Return the state of all worlds, the engine's warm start included; see :meth:`Simulator.snapshot`."""
        hidden = {key: dict(value.flatten_keys(".").clone().items()) for key, value in self._hidden.items()}
        return {"theta": self._theta.clone(), "hidden": hidden, **self._worlds.snapshot()}

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Stand where a snapshot was taken; see :meth:`Simulator.restore`."""
        self._theta = snapshot["theta"].clone()
        for key, value in snapshot["hidden"].items():
            flat = TensorDict(dict(value), batch_size=(self.worlds,))
            self._hidden[key] = flat.unflatten_keys(".").clone()
        self._worlds.write_theta(to_host(self._theta))
        self._worlds.restore(snapshot)

    def step(self, inputs: TensorDictBase) -> TensorDict:
        """Advance every world that has not failed by ``dt``."""
        command, enable = inputs.get("command").to(torch.float64), inputs.get("enable", None)
        self._worlds.write_enable(None if enable is None else to_host(enable))
        steps = self._steps if self._system.stages or self._system.staged else 1
        ctrl, after, _ = self._system.drive(self._theta, self._hidden, command[:, None].expand(-1, steps, -1))
        stage = self._worlds.stage
        if stage is not None:
            stage.hidden = {e.key: self._hidden[e.key] for e in self._system.staged if e.key in self._hidden}
        if self._system.stages or stage is not None:
            self._worlds.follow(ctrl)
        else:
            self._worlds.hold(ctrl[:, 0], self._steps)
        if stage is not None:
            after.update(stage.hidden)
        going = torch.from_numpy(~self._worlds.failed)
        for key, hidden in after.items():
            self._hidden[key][going] = hidden[going]
        return self.state

    def rollout(
        self,
        theta: Float[Tensor, "M P"],
        state: TensorDictBase,
        inputs: TensorDictBase,
        times: Float[Tensor, " T"],
    ) -> TensorDict:
        """Trajectories of M worlds; see :meth:`Simulator.rollout`. Without force stages all runs in the engine."""
        return rollout(self._system, self._blueprint.threads, _finite(theta), state, inputs, times)

    def project_onto_constraints(self, state: TensorDictBase) -> TensorDictBase:
        """The nearest states on the active equality constraints, unless these are soft; see :mod:`.closure`."""
        if self._closure is None or soft(self._system.source):
            return state
        qpos, qvel = self._closure.nearest(to_host(state.get("qpos")), to_host(state.get("qvel")))
        closed = state.to(self.device).clone(recurse=False)
        closed["qpos"], closed["qvel"] = torch.from_numpy(qpos), torch.from_numpy(qvel)
        return closed

    def constrained_positions(self, path: Float[Tensor, "T J"], known: Sequence[int]) -> Float[Tensor, "T J"]:
        """See :meth:`Identifiable.constrained_positions`; of models of slides and hinges."""
        if self._closure is None or self.model.nq != len(self.joint_kinds):
            return super().constrained_positions(path, known)
        full, determined = self._closure.follow(to_host(path), known)
        for j in {*range(path.shape[1])} - {*known}:
            full[~determined, j] = np.nan
        return torch.from_numpy(full)

    def hidden_states_along(
        self, theta: Float[Tensor, "N P"], motion: TensorDictBase, step: float
    ) -> dict[str, TensorDict]:
        """Hidden states of force stages along a known motion; see :meth:`Identifiable.hidden_states_along`."""
        return hidden_states_along(self._system, _finite(theta), motion.to(self.device), step)

    def command_driven_states(
        self, theta: Float[Tensor, "N P"], command: Float[Tensor, "N K U"], step: float
    ) -> dict[str, Float[Tensor, "N K1 n"]]:
        """Activations where all are filters or integrators; see :meth:`Identifiable.command_driven_states`."""
        return activations(self._system, _finite(theta), command.to(self.device), step)

    @property
    def memory_span(self) -> float:
        """Ten times the longest time constant of an activation [s]; see :attr:`Identifiable.memory_span`."""
        return memory_span(self._system)

    @property
    def integrating_commands(self) -> tuple[str, ...]:
        """Commands of actuators that integrate; see :attr:`Identifiable.integrating_commands`."""
        return inventory.integrating_commands(self._system)

    def actuator_forces(
        self, theta: Float[Tensor, "N P"], motion: TensorDictBase, step: float
    ) -> Float[Tensor, "N K U"]:
        """See :meth:`Identifiable.actuator_forces`; of an actuator on no joint, its gain times its command."""
        return actuator_forces(self._system, _finite(theta), motion.to(self.device), step)

    def read(self, state: TensorDictBase) -> Float[Tensor, "*batch S"]:
        """Positions, then velocities, in the model's order, then the sensors that are signals."""
        sensors = [state.get("sensor")] if self._system.sensors else []
        return torch.cat([state.get("qpos"), state.get("qvel"), *sensors], dim=-1)

    def shapes(self, theta: Float[Tensor, " P"]) -> tuple[Shape, ...]:
        """The model's visible geoms as it was built; see :class:`~onlinebayes.simulators.Drawable`."""
        return drawing.shapes(self.model)

    def poses(self, theta: Float[Tensor, " P"], states: TensorDictBase) -> Float[Tensor, "T S 7"]:
        """Return the poses of these geoms in the states."""
        return drawing.poses(self.model, to_host(states.get("qpos")))

    def picture(
        self,
        theta: Float[Tensor, " P"],
        state: TensorDictBase,
        size: tuple[int, int],
        beside: tuple[Sequence[Shape], Float[Tensor, "S 7"]],
    ) -> UInt8[np.ndarray, "H W 3"]:
        """A world by MuJoCo's renderer; see :class:`~onlinebayes.simulators.pictures.Pictured`."""
        if size not in self._renderers:
            self._renderers[size] = Renderer(self._system, size)
        return self._renderers[size].picture(theta, state, beside)

    @property
    def system(self) -> MujocoSystem:
        """The compiled system with its effects; not to be changed."""
        return self._system

    def fields(self, theta: Float[np.ndarray, "N P"]) -> dict[str, np.ndarray]:
        """The per-world arrays (N, ...) of the model's fields that parameters and effects set, by MuJoCo's names."""
        return self._system.write(theta)

    def export(self, theta: Float[Tensor, " P"]) -> mujoco.MjSpec:
        """One world as a spec with every parameter and native effect written in; see :mod:`.export`."""
        return export(self._system, to_host(_finite(theta[None])))

    def export_xml(self, theta: Float[Tensor, " P"]) -> str:
        """:meth:`export` as MJCF text with all 17 digits, which plain MuJoCo loads and replays alike."""
        return to_xml(self.export(theta))

    def not_exportable(self, theta: Float[Tensor, " P"]) -> Mapping[str, str]:
        """Keys of the effects that :meth:`export` has to leave out at these parameters -> why; see :mod:`.foreign`."""
        return not_exportable(self._system, to_host(_finite(theta[None])))

    def bodies_with_adjusted_inertia(self, theta: Float[Tensor, " P"]) -> tuple[str, ...]:
        """Names of the bodies of which :meth:`export` holds other moments of inertia than these, which no body has."""
        return bodies_with_adjusted_inertia(self._system, to_host(_finite(theta[None])))


def _finite(theta: Tensor) -> Tensor:
    if not bool(theta.isfinite().all()):
        raise BadInput("theta is not finite", "give every parameter a finite value")
    return theta.detach().to(device="cpu", dtype=torch.float64)
