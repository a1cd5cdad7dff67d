"""Parameters that ``mujoco.sysid`` may free: all that an MJCF can say about the machine, with bounds and names.

| parameter                        | where                       | claims                                       |
|----------------------------------|-----------------------------|----------------------------------------------|
| the problem's own                | its address                 | nothing                                      |
| damping, frictionloss, stiffness | joint                       | viscous_friction, dry_friction, ...          |
| quadratic and cubic coefficients | joint                       | quadratic_drag, cubic_stiffness              |
| load                             | a bias actuator, gain 0     | constant_load                                |
| armature, centre of mass         | hinge and its body          | armature, com_offset and their equals        |
| density, wind                    | option, for what flies      | air_drag, wind                               |
| gain, force limit                | actuator                    | actuator_gain, actuator_saturation           |
| late                             | the sensors, sysid's own way| actuator_delay, actuator_lag, sensor_delay   |

Twins that the equations cannot tell apart are freed once, and claim all names of both: freed twice each would have an
infinite interval. Bounds of forces are the largest force in play, as criticism's own candidates have them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import mujoco
from torch import Tensor

from onlinebayes.criticism import target_scales
from onlinebayes.identification import joint_names
from onlinebayes.runs import BadInput
from recipes.studies.versus_sysid.task import Claim, Task

Setter = Callable[[mujoco.MjSpec, float], None]


@final
@dataclass(frozen=True)
class Freed:
    """One parameter.

    Args:
        name: of it.
        low, high: its bounds [SI].
        nominal: the value that claims nothing.
        start: where the search begins.
        claim: what leaving ``nominal`` says; empty for the problem's own.
        write: puts a value into a spec; None for what is no part of the model.
    """

    name: str
    low: float
    high: float
    nominal: float
    start: float
    claim: Claim = frozenset()
    write: Setter | None = None


def problem_parameters(task: Task, start: Tensor) -> list[Freed]:
    """The problem's own, from these values on [SI]."""
    return [
        Freed(address, bounds.low, bounds.high, value, value, frozenset(), setter(address))
        for (address, bounds), value in zip(task.simulator.parameters.items(), start.tolist(), strict=True)
    ]


def setter(address: str) -> Setter:
    """Writes a value where an address of the contract points.

    Raises:
        BadInput: a kind of address that no case of this study has.
    """
    kind, name, entry = address.split(".")

    def write(spec: mujoco.MjSpec, value: float) -> None:
        if kind == "body":
            spec.body(name).mass = value
        elif kind == "joint" and entry == "damping":
            spec.joint(name).damping[0] = value
        elif kind == "joint":
            spec.joint(name).armature = value
        elif entry == "gear[0]":
            spec.actuator(name).gear[0] = value
        else:
            spec.actuator(name).gainprm[0], spec.actuator(name).biasprm[1] = value, -value

    known = {"body": ("mass",), "joint": ("damping", "armature"), "actuator": ("gear[0]", "kp")}
    if entry not in known.get(kind, ()):
        raise BadInput(f"'{address}' is none of the parameters that the comparison writes", "add it to setter()")
    return write


def prepared(task: Task) -> mujoco.MjSpec:
    """The engineer's spec with a bias actuator at every joint, behind its own."""
    spec = task.simulator.spec.copy()
    for joint in joint_names(task.simulator):
        load = spec.add_actuator()
        load.name, load.target, load.trntype = f"load@{joint}", joint, mujoco.mjtTrn.mjTRN_JOINT
        load.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        load.gainprm[0] = 0.0
    return spec


def every_parameter(task: Task) -> list[Freed]:
    """The problem's own and all others."""
    found = problem_parameters(task, task.base_theta)
    flies = len(joint_names(task.simulator)) == 3 and set(task.simulator.joint_kinds.values()) == {"slide"}
    for joint in joint_names(task.simulator):
        found += _of_joint(task, joint, flies)
    if flies:
        found += _of_fluid(task)
    for a, name in enumerate(task.simulator.commands):
        found += _of_actuator(task, a, name)
    late = frozenset(
        f"{kind}@{name}" for name in task.simulator.commands for kind in ("actuator_delay", "actuator_lag")
    )
    sensors = frozenset(f"sensor_delay@{signal}" for signal in task.signals if signal.startswith("qpos"))
    longest = 0.1 * task.steadied.horizon_s
    return [*found, Freed("late", 0.0, longest, 0.0, 0.02 * longest, late | sensors)]


def _of_joint(task: Task, joint: str, flies: bool) -> list[Freed]:
    simulator = task.simulator
    scales = target_scales(simulator, task.fit_windows, "joint", joint)
    free, hinge = simulator.parameters, scales.unit == "hinge"
    F, v, q = scales.force, scales.speed, scales.travel

    def new(name: str, high: float, claim: tuple[str, ...], write: Setter, low: float = 0.0, at: float = 0.02) -> Freed:
        return Freed(f"{name}@{joint}", low, high, 0.0, at * high, frozenset(claim), write)

    def entry(field: str, index: int | None = None) -> Setter:
        def write(spec: mujoco.MjSpec, value: float) -> None:
            if index is None:
                setattr(spec.joint(joint), field, value)
            else:
                getattr(spec.joint(joint), field)[index] = value

        return write

    def load(spec: mujoco.MjSpec, value: float) -> None:
        spec.actuator(f"load@{joint}").biasprm[0] = value

    found = [
        new("frictionloss", F, (f"dry_friction@{joint}",), entry("frictionloss")),
        new("stiffness", 2 * F / q, (f"joint_stiffness@{joint}",), entry("stiffness", 0)),
        new("load", F, (f"constant_load@{joint}",), load, low=-F, at=0.0),
    ]
    if f"joint.{joint}.damping" not in free:
        found.append(new("damping", F / v, (f"viscous_friction@{joint}",), entry("damping", 0)))
    if not flies:
        found.append(new("drag", F / v**2, (f"quadratic_drag@{joint}",), entry("damping", 1)))
    if hinge:
        found.append(new("stiffness3", 8 * F / q**3, (f"cubic_stiffness@{joint}",), entry("stiffness", 2)))
        found += _of_hinge(task, joint, scales.inertia)
    return found


def _of_hinge(task: Task, joint: str, inertia: float) -> list[Freed]:
    """Armature, unless the problem frees it, and the centre of mass across the link."""
    model = task.simulator.model
    body = model.body(model.joint(joint).bodyid[0]).name
    own = float(model.dof_armature[model.joint(joint).dofadr[0]])
    reach = 0.2 * float(abs(model.body(body).ipos).max())

    def across(spec: mujoco.MjSpec, value: float) -> None:
        spec.body(body).ipos[0] = value

    tilted = frozenset({f"com_offset@{body}.x", "gravity_tilt@world.x", f"sensor_bias@qpos.{joint}"})
    heavy = frozenset({f"armature@{joint}", f"com_offset@{body}.z", "gravity_tilt@world.y"})
    found = [Freed(f"com_x@{body}", -reach, reach, 0.0, 0.0, tilted, across)]
    if f"joint.{joint}.armature" not in task.simulator.parameters:
        start = own + 0.02 * inertia
        found.append(
            Freed(f"armature@{joint}", 0.0, own + inertia, own, start, heavy, setter(f"joint.{joint}.armature"))
        )
    return found


def _of_fluid(task: Task) -> list[Freed]:
    """MuJoCo's fluid on the body's box of inertia."""
    body = task.simulator.model.body(task.simulator.model.nbody - 1).name

    def density(spec: mujoco.MjSpec, value: float) -> None:
        spec.option.density = value

    def wind(axis: int) -> Setter:
        def write(spec: mujoco.MjSpec, value: float) -> None:
            spec.option.wind[axis] = value

        return write

    drag = Freed("density", 0.0, 20.0, 0.0, 0.5, frozenset({f"air_drag@{body}", "wind@world"}), density)
    blowing = [Freed(f"wind_{'xy'[k]}", -10.0, 10.0, 0.0, 0.0, frozenset({"wind@world"}), wind(k)) for k in (0, 1)]
    return [drag, *blowing]


def _of_actuator(task: Task, a: int, name: str) -> list[Freed]:
    """Gain, unless the masses scale with it, and limit, which begins just below the largest force."""
    model = task.simulator.model
    gain, bias, gear = (
        float(x) for x in (model.actuator_gainprm[a, 0], model.actuator_biasprm[a, 1], model.actuator_gear[a, 0])
    )
    joint = model.joint(model.actuator_trnid[a, 0]).name
    pulled = gain * task.fit_windows.command[..., a]
    if bias and f"qpos.{joint}" in task.signals:  # a servo pulls by its distance from the goal
        pulled = pulled + bias * gear * task.fit_windows.value[..., task.signals.index(f"qpos.{joint}")]
    largest = float(pulled.abs().max())

    def limited(spec: mujoco.MjSpec, value: float) -> None:
        spec.actuator(name).forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        spec.actuator(name).forcerange[:] = (-value, value)

    def scaled(spec: mujoco.MjSpec, value: float) -> None:
        spec.actuator(name).gear[0] = gear * (1 + value)

    limit = frozenset({f"actuator_saturation@{name}"})
    found = [Freed(f"limit@{name}", 0.2 * largest, 1.05 * largest, 1.05 * largest, 0.97 * largest, limit, limited)]
    heavy = any(p.startswith("body.") and p.endswith(".mass") for p in task.simulator.parameters)
    if bias == 0 and gain != 0 and (a > 0 or not heavy):
        found.append(Freed(f"gain@{name}", -0.6, 0.6, 0.0, 0.0, frozenset({f"actuator_gain@{name}"}), scaled))
    return found
