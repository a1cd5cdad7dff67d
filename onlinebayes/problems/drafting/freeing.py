"""The choice of the parameters that a first problem file frees, and of their bounds.

In this order: damping of every joint, the moment of inertia about a vertical hinge, kp and kv of servos, mass
of every body that a joint carries, moments of inertia of free bodies, then what the model sets at all of frictionloss,
armature and stiffness, and the gears of motors where no mass is free: all masses, dampings and gears times one factor
move alike, but for moments of inertia that nobody measured. A free joint has one damping for forces and torques alike,
freed only where the model sets it.
With measurements a parameter is freed only where its sensitivity is no combination of those before it,

    |c~|^2 > 0.01 |c|^2,      c the start-projected sensitivity, c~ what the freed ones leave of it

so that a mass that a vertical hinge turns is not freed beside its moment. Without measurements dampings, gains of
servos and masses are freed. Bounds: a third to three times the model's value, of a servo's gain from a tenth on; what
a machine may have none of (damping, friction, armature, stiffness) from zero. Where the model has no damping its bound
is the largest force in play over the largest speed, or, without measurements, what would stop the joint in a tenth of
a second.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
import torch

from onlinebayes.criticism import target_scales
from onlinebayes.identification import Windows, charted, linearise, make_windows, project
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.problems.drafting.actuator_inputs import actuator_inputs
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco.addresses import names, resolve

FACTOR = 3.0
SERVO = 10.0
"""A servo's gain may be so many times smaller: few makers give one, and firmware has units of its own."""
STOP = 10.0  # [1/s]
OWN = 0.01
MOST_WINDOWS, FEWEST_WINDOWS = 12, 3
MOST_COLUMNS = 240
"""Windows times parameters of which sensitivities are asked: many joints show what they show in few windows."""
UPRIGHT = 0.99
"""Cosine between a hinge's axis and gravity, from which on the axis is vertical."""


def free_parameters(model: MujocoSimulator, measurement: Measurement | None = None) -> ParameterSpace:
    """Parameters to free.

    Args:
        model: without free parameters.
        measurement: what the problem is about, or None where it is not known yet.
    """
    if measurement is not None:
        try:
            simulator, turned = charted(model, measurement)
            windows = make_windows(simulator, turned, 1.0)
            scales = {joint: target_scales(simulator, windows, "joint", joint) for joint in simulator.targets("joint")}
            proposed = _proposed(model.model, {joint: scale.force / scale.speed for joint, scale in scales.items()})
            return proposed.subspace(_without_scale(_distinct(model, proposed, measurement, windows)))
        except BadInput:  # the log does not suit the model yet; its owner learns of it from the first run
            pass
    proposed = _proposed(model.model, {})
    return proposed.subspace([name for name in proposed if name.endswith((".damping", ".kp", ".kv", ".mass"))])


def _proposed(model: mujoco.MjModel, most: dict[str, float]) -> ParameterSpace:
    """Every parameter that may be freed, the one to free first in front; ``most`` bounds dampings that are zero."""
    joints, bodies, motors = (names(model, kind) for kind in ("joint", "body", "actuator"))
    found: dict[str, Parameter] = {}
    for i, joint in enumerate(joints):
        dof = int(model.jnt_dofadr[i])
        own, inertia = float(model.dof_damping[dof]), float(model.dof_M0[dof])
        if _is_free(model, i) and own == 0:
            continue
        found[f"joint.{joint}.damping"] = Parameter(0.0, FACTOR * own or most.get(joint, STOP * inertia) or 1.0)
    for i, body in enumerate(bodies):
        if body and (axis := _vertical(model, i)) is not None:
            found |= _around(f"body.{body}.inertia[{axis}]", float(model.body_inertia[i, axis]))
    servos = {name for name, given in actuator_inputs(model).items() if given.told in ("qpos", "qvel")}
    for i, motor in enumerate(motors):
        if f"ctrl.{motor}" in servos:
            found |= _gains(model, i)
    for i, body in enumerate(bodies):
        if body and model.body_jntnum[i] and model.body_mass[i] > 0:
            found |= _around(f"body.{body}.mass", float(model.body_mass[i]))
    for i, body in enumerate(bodies):
        if body and model.body_jntnum[i] and _is_free(model, int(model.body_jntadr[i])):
            for axis, moment in enumerate(model.body_inertia[i]):
                found |= _around(f"body.{body}.inertia[{axis}]", float(moment))
    of_dofs = {"frictionloss": model.dof_frictionloss, "armature": model.dof_armature}
    passive = {name: values[model.jnt_dofadr] for name, values in of_dofs.items()}
    for field, values in (passive | {"stiffness": model.jnt_stiffness}).items():
        for joint, value in zip(joints, values, strict=True):
            found |= {f"joint.{joint}.{field}": Parameter(0.0, FACTOR * float(value))} if value > 0 else {}
    for i, motor in enumerate(motors):
        if f"ctrl.{motor}" not in servos:
            found |= _around(f"actuator.{motor}.gear[0]", float(model.actuator_gear[i, 0]))
    units = {name: resolve(model, name).unit for name in found}
    return ParameterSpace({name: Parameter(_round(p.low), _round(p.high), units[name]) for name, p in found.items()})


def _gains(model: mujoco.MjModel, actuator: int) -> dict[str, Parameter]:
    """Kp, and kv where there is one, of a position servo; kv of a velocity servo."""
    name, gain = model.actuator(actuator).name, float(model.actuator_gainprm[actuator, 0])
    main = Parameter(gain / SERVO, FACTOR * gain)
    if model.actuator_biasprm[actuator, 1] == 0:
        return {f"actuator.{name}.kv": main}
    kv = -float(model.actuator_biasprm[actuator, 2])
    beside = {f"actuator.{name}.kv": Parameter(0.0, FACTOR * kv)} if kv > 0 else {}
    return {f"actuator.{name}.kp": main, **beside}


def _is_free(model: mujoco.MjModel, joint: int) -> bool:
    return bool(model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE)


def _vertical(model: mujoco.MjModel, body: int) -> int | None:
    """Find the principal moment of a body that a vertical hinge, its only joint, turns; None where there is none.

    About such an axis gravity does nothing, and of mass and moment only one number shows.
    """
    if model.body_jntnum[body] != 1 or model.body_parentid[body] != 0:
        return None
    joint, gravity = int(model.body_jntadr[body]), model.opt.gravity
    if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE or not model.body_inertia[body].any():
        return None
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    axis = data.xaxis[joint]
    if abs(float(axis @ gravity)) < UPRIGHT * float(np.linalg.norm(gravity)) or not gravity.any():
        return None
    return int(np.abs(axis @ data.ximat[body].reshape(3, 3)).argmax())


def _around(name: str, value: float) -> dict[str, Parameter]:
    """A third to three times the value; nothing where it is zero."""
    if value == 0:
        return {}
    low, high = sorted((value / FACTOR, value * FACTOR))
    return {name: Parameter(low, high)}


def _round(value: float) -> float:
    return float(f"{value:.3g}")


def _without_scale(chosen: Sequence[str]) -> list[str]:
    """Without the gears where masses or moments are free."""
    inertial = any(name.startswith("body.") for name in chosen)
    return [name for name in chosen if not (inertial and ".gear[" in name)]


def _distinct(
    model: MujocoSimulator, proposed: ParameterSpace, measurement: Measurement, windows: Windows
) -> list[str]:
    """Those whose sensitivity no combination of earlier ones gives."""
    free, _ = charted(MujocoSimulator(model.spec, proposed, threads=1), measurement)
    most = min(MOST_WINDOWS, max(FEWEST_WINDOWS, MOST_COLUMNS // max(len(proposed), 1)))
    windows = windows.select(torch.arange(windows.count)[:: -(-windows.count // most)])
    lin = linearise(free, windows, proposed.clamp(free.nominal), windows.start)
    if not lin.valid:
        raise BadInput("the simulation diverges at the model's own values", "give the model a finer timestep")
    columns = project(windows, lin).columns.flatten(0, 1) * (proposed.high - proposed.low)
    chosen: list[str] = []
    basis = columns.new_zeros(len(columns), 0)
    largest = columns.norm(dim=0).max()
    for i, name in enumerate(proposed):
        c = columns[:, i]
        rest = c - basis @ (basis.T @ c)
        if float(rest.square().sum()) > OWN * float(c.square().sum()) and float(rest.norm()) > 1e-6 * float(largest):
            chosen.append(name)
            basis = torch.cat([basis, (rest / rest.norm())[:, None]], 1)
    return chosen
