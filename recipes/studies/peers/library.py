"""The library of laws for sparse regression: every instantaneous effect of the vocabulary, as a force at the joints.

    F = sum_k xi_k phi_k(q, v, drives),     linear in xi; what is not (a dead time, poles, a limit) has a fixed shape

Where a shape belongs to what is hidden the library is given its true value, else a usual one: the true term is in it.
Armature is no force of q and v: it joins the model's parameters instead.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import final

import mujoco
import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from onlinebayes.identification import Windows, joint_names
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator
from recipes.studies.peers.task import Claim, Task
from recipes.studies.peers.worlds import Course, course

Law = Callable[[Float[ndarray, "N J"], Float[ndarray, "N J"], Course], Float[ndarray, "N J"]]


@final
@dataclass(frozen=True)
class Term:
    """phi_k, and what a method that uses it claims; springs make a constant their rest position's."""

    claim: Claim
    law: Law


@final
@dataclass(frozen=True)
class Library:
    """The terms for one task.

    Args:
        simulator: the base model, armatures among its parameters where the library may move them.
        added: addresses of these -> what moving them claims.
        terms: the laws.
        shapes: dead time, lag and so on of every actuator, for :func:`course`.
    """

    simulator: MujocoSimulator
    added: Mapping[str, Claim]
    terms: tuple[Term, ...]
    shapes: tuple[ndarray, ndarray, ndarray, ndarray]

    def course(self, windows: Windows) -> Course:
        """What the commands of the windows amount to."""
        return course(windows, *self.shapes)

    def evaluate(self, q: ndarray, v: ndarray, now: Course) -> Float[ndarray, "N T J"]:
        """All terms at N states."""
        return np.stack([term.law(q, v, now) for term in self.terms], 1)


@final
@dataclass(frozen=True)
class Actuation:
    """Forces of the base model's actuators on the joints: G (gain u + b0 + b1 G q + b2 G v), as fitted.

    Args:
        joint: index of the joint that each drives.
        gear, gain, bias: of each.
    """

    joint: list[int]
    gear: Float[ndarray, " U"]
    gain: Float[ndarray, " U"]
    bias: Float[ndarray, "U 3"]

    @classmethod
    def of(cls, model: mujoco.MjModel) -> Actuation:
        """Of a compiled model whose actuators act on joints."""
        joint = [int(model.jnt_dofadr[j]) for j in model.actuator_trnid[:, 0]]
        gain, bias = model.actuator_gainprm[:, 0].copy(), model.actuator_biasprm[:, :3].copy()
        bias[model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE] = 0.0
        return cls(joint, model.actuator_gear[:, 0].copy(), gain, bias)

    def of_command(self, a: int, u: Float[ndarray, " N"]) -> Float[ndarray, " N"]:
        """The part that is proportional to a command of actuator a [N, N m]."""
        return self.gear[a] * self.gain[a] * u

    def force(self, a: int, q: ndarray, v: ndarray, u: Float[ndarray, " N"]) -> Float[ndarray, " N"]:
        """Actuator a's force on its joint [N, N m]."""
        j, g = self.joint[a], self.gear[a]
        return g * (self.gain[a] * u + self.bias[a] @ np.stack([np.ones_like(u), g * q[:, j], g * v[:, j]]))


def library(task: Task) -> Library:
    """The library for a task; sizes that shapes need are taken from its fit windows."""
    joints, U = joint_names(task.simulator), len(task.simulator.commands)
    model = task.simulator.export(task.base_theta).compile()
    acts, windows = Actuation.of(model), task.fit_windows
    largest = np.maximum(windows.command.abs().amax((0, 1)).numpy(), 1e-9)
    names = task.simulator.commands
    dead = np.array([task.shapes.get(f"actuator_delay@{n}.delay", 0.0) for n in names])
    lag = np.array([task.shapes.get(f"actuator_lag@{n}.time_constant", 0.0) for n in names])
    for a, j in enumerate(acts.joint):  # a late sensor sees what a late command does
        dead[a] = dead[a] or task.shapes.get(f"sensor_delay@qpos.{joints[j]}.delay", 0.0)
    dead = np.where((dead == 0) & (lag == 0), 5e-3, dead)
    warming = np.array([task.shapes.get(f"thermal_derating@{n}.time_constant", 2.0) for n in names])
    terms: list[Term] = []
    for j, joint in enumerate(joints):
        terms += _joint_terms(task, windows, joint, j, acts)
    for a in range(U):
        terms += _actuator_terms(task, a, acts, float(largest[a]), joints[acts.joint[a]])
    if len(joints) == 3 and all(kind == "slide" for kind in task.simulator.joint_kinds.values()):
        terms += _fluid_terms(task)
    added = _armatures(task, joints)
    return Library(_with_armatures(task.simulator, added), added, tuple(terms), (dead, lag, warming, largest))


def _joint_terms(task: Task, windows: Windows, joint: str, j: int, acts: Actuation) -> list[Term]:
    """Friction, springs, loads, cogging of one joint."""
    J = len(joint_names(task.simulator))
    q0, v0 = windows.start[:, j].numpy(), windows.start[:, windows.start.shape[1] // 2 + j].numpy()
    speed, travel = max(float(np.abs(v0).max()), 1e-6), max(float(np.ptp(q0)), 1e-6)
    slow = task.shapes.get(f"stribeck_friction@{joint}.stribeck_velocity", 0.1 * speed)
    poles = task.shapes.get(f"cogging@{joint}.poles", 16 * np.pi / travel)
    hinge = task.simulator.joint_kinds.get(joint) == "hinge"
    body = task.simulator.model.body(task.simulator.model.joint(joint).bodyid[0]).name
    when = task.shapes.get(
        f"parameter_step@joint.{joint}.damping.time", 0.5 * float(windows.first.max()) * windows.step
    )

    def at(names: tuple[str, ...], law: Callable[[ndarray, ndarray, Course], ndarray]) -> Term:
        def force(q: ndarray, v: ndarray, now: Course) -> ndarray:
            found = np.zeros((len(q), J))
            found[:, j] = law(q[:, j], v[:, j], now)
            return found

        return Term(frozenset(names), force)

    def load(q: ndarray, v: ndarray, now: Course) -> ndarray:
        del q, v
        sizes = [np.abs(acts.of_command(a, now.command[:, a])) for a, on in enumerate(acts.joint) if on == j]
        return np.sum(sizes, 0) if sizes else np.zeros(len(now.time))

    found = [
        at((f"dry_friction@{joint}",), lambda q, v, now: -np.sign(v)),
        at((f"stribeck_friction@{joint}",), lambda q, v, now: -np.exp(-((v / slow) ** 2)) * np.sign(v)),
        at((f"quadratic_drag@{joint}",), lambda q, v, now: -v * np.abs(v)),
        at((f"joint_stiffness@{joint}",), lambda q, v, now: -q),
        at((f"cubic_stiffness@{joint}",), lambda q, v, now: -(q**3)),
        at((f"constant_load@{joint}",), lambda q, v, now: np.ones_like(q)),
        at((f"cogging@{joint}",), lambda q, v, now: np.sin(poles * q)),
        at((f"cogging@{joint}",), lambda q, v, now: np.cos(poles * q)),
    ]
    if j in acts.joint:
        found.append(at((f"load_dependent_friction@{joint}",), lambda q, v, now: -load(q, v, now) * np.sign(v)))
    if hinge:
        tilted = (f"com_offset@{body}.x", "gravity_tilt@world.x", f"sensor_bias@qpos.{joint}")
        found.append(at(tilted, lambda q, v, now: np.cos(q)))
    damping = f"joint.{joint}.damping"
    if damping not in task.simulator.parameters:
        emf = tuple(f"back_emf@{n}" for n, on in zip(task.simulator.commands, acts.joint, strict=True) if on == j)
        found.append(at((f"viscous_friction@{joint}", *emf), lambda q, v, now: -v))
    else:
        found.append(at((f"parameter_drift@{damping}",), lambda q, v, now: -v * now.time))
        found.append(at((f"parameter_step@{damping}",), lambda q, v, now: -v * (now.time >= when)))
    return found


def _actuator_terms(task: Task, a: int, acts: Actuation, largest: float, joint: str) -> list[Term]:
    """Gain, lateness, dead zone, limit and heat of one actuator."""
    name, J = task.simulator.commands[a], len(joint_names(task.simulator))
    width = task.shapes.get(f"actuator_dead_zone@{name}.width", 0.05 * largest)
    limit = abs(float(acts.gear[a])) * task.shapes.get(
        f"actuator_saturation@{name}.limit", 0.8 * largest * abs(float(acts.gain[a]))
    )
    j = acts.joint[a]

    def at(names: tuple[str, ...], law: Callable[[ndarray, ndarray, ndarray, Course], ndarray]) -> Term:
        def force(q: ndarray, v: ndarray, now: Course) -> ndarray:
            found = np.zeros((len(q), J))
            found[:, j] = law(now.command[:, a], acts.force(a, q, v, now.command[:, a]), q, now)
            return found

        return Term(frozenset(names), force)

    lagging = f"actuator_lag@{name}.time_constant" in task.shapes
    late = (f"actuator_delay@{name}", f"actuator_lag@{name}", f"sensor_delay@qpos.{joint}")
    terms = [
        at(
            late,
            lambda u, f, q, now: acts.of_command(a, (now.lagged if lagging else now.late)[:, a] - u),
        ),
        at((f"actuator_dead_zone@{name}",), lambda u, f, q, now: -acts.of_command(a, np.clip(u, -width, width))),
        at((f"actuator_saturation@{name}",), lambda u, f, q, now: np.clip(f, -limit, limit) - f),
        at((f"thermal_derating@{name}",), lambda u, f, q, now: -f * now.heat[:, a]),
    ]
    # With a mass free the scale of the only force, or of the first, is nobody's to know.
    scaled = any(p.startswith("body.") and p.endswith(".mass") for p in task.simulator.parameters)
    if a > 0 or not scaled:
        terms.append(at((f"actuator_gain@{name}",), lambda u, f, q, now: f))
    return terms


def _fluid_terms(task: Task) -> list[Term]:
    """Drag of a body that flies, in still air and in wind."""
    body = task.simulator.model.body(task.simulator.model.nbody - 1).name
    blows = np.array([task.shapes.get(f"wind@world.{axis}", 3.0 if axis == "x" else 0.0) for axis in "xyz"])

    def drag(q: ndarray, v: ndarray, now: Course) -> ndarray:
        return -v * np.linalg.norm(v, axis=1, keepdims=True)

    def blown(q: ndarray, v: ndarray, now: Course) -> ndarray:
        return drag(q, v - blows, now)

    return [Term(frozenset({f"air_drag@{body}"}), drag), Term(frozenset({"wind@world"}), blown)]


def _armatures(task: Task, joints: tuple[str, ...]) -> dict[str, Claim]:
    """Armatures of hinges that are not free anyway; a slide's is its mass."""
    kinds = task.simulator.joint_kinds
    free = [j for j in joints if kinds.get(j) == "hinge" and f"joint.{j}.armature" not in task.simulator.parameters]
    model = task.simulator.model
    found = {}
    for joint in free:
        body = model.body(model.joint(joint).bodyid[0]).name
        equals = (f"armature@{joint}", f"com_offset@{body}.z", "gravity_tilt@world.y")
        found[f"joint.{joint}.armature"] = frozenset(equals)
    return found


def _with_armatures(simulator: MujocoSimulator, added: Mapping[str, Claim]) -> MujocoSimulator:
    model = simulator.model
    extra = {}
    for address in added:
        dof = int(model.joint(address.split(".")[1]).dofadr[0])
        inertia = _inertia(model, dof)
        extra[address] = Parameter(-0.5 * inertia, 2 * inertia, "kg m2")
    space = ParameterSpace({**dict(simulator.parameters.items()), **extra})
    return MujocoSimulator(simulator.spec, space, threads=1)


def _inertia(model: mujoco.MjModel, dof: int) -> float:
    data, full = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, full)
    return float(full[dof, dof])


def base_theta(made: Library, task: Task) -> Float[ndarray, " P"]:
    """The base fit's theta, the armatures as the model has them."""
    nominal = made.simulator.nominal
    return torch.cat([task.base_theta, nominal[len(task.base_theta) :]]).numpy()
