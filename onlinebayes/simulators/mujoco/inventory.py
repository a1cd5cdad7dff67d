"""The elements of a compiled model that effects can act on, and those that commands drive: names, kinds, sizes."""

from __future__ import annotations

from typing import Literal

import mujoco

from onlinebayes.simulators.mujoco.activation import INTEGRATING
from onlinebayes.simulators.mujoco.addresses import HINGE, SLIDE, names
from onlinebayes.simulators.mujoco.native.air import body_size
from onlinebayes.simulators.mujoco.system import MujocoSystem

FED_BY_COMMAND = frozenset(
    int(kind)
    for kind in (
        mujoco.mjtDyn.mjDYN_NONE,
        mujoco.mjtDyn.mjDYN_INTEGRATOR,
        mujoco.mjtDyn.mjDYN_FILTER,
        mujoco.mjtDyn.mjDYN_FILTEREXACT,
        mujoco.mjtDyn.mjDYN_MUSCLE,
    )
)
"""Kinds of activation that the control alone drives."""


def joint_kinds(model: mujoco.MjModel) -> dict[str, Literal["slide", "hinge"]]:
    """Name -> kind of every slide and hinge joint."""
    kinds: dict[str, Literal["slide", "hinge"]] = {}
    for name, kind in zip(names(model, "joint"), model.jnt_type, strict=True):
        if kind in (SLIDE, HINGE):
            kinds[name] = "slide" if kind == SLIDE else "hinge"
    return kinds


def moving_sites(model: mujoco.MjModel) -> tuple[str, ...]:
    """Names of the sites on bodies that move."""
    moving = model.body_weldid[model.site_bodyid] != 0
    return tuple(name for name, moves in zip(names(model, "site"), moving, strict=True) if name and moves)


def body_sizes(model: mujoco.MjModel) -> dict[str, tuple[float, float]]:
    """Mass [kg] of each named body that moves, and half the diagonal of the box with its inertia [m]."""
    sizes = {}
    for i, name in enumerate(names(model, "body")):
        if name and model.body_weldid[i] and (size := body_size(model, i)):
            sizes[name] = (float(model.body_mass[i]), size)
    return sizes


def moving_joints(model: mujoco.MjModel) -> dict[str, tuple[str, ...]]:
    """Names of the joints between the world and each of :func:`body_sizes`."""
    joints = names(model, "joint")
    chains: list[tuple[str, ...]] = [()]
    for i in range(1, model.nbody):
        first, count = int(model.body_jntadr[i]), int(model.body_jntnum[i])
        chains.append((*chains[model.body_parentid[i]], *joints[first : first + count]))
    return {name: chains[model.body(name).id] for name in body_sizes(model)}


def fed_by_command(model: mujoco.MjModel) -> frozenset[str]:
    """``"act"``, where every actuator's activation is a filter's, an integrator's or a muscle's."""
    return frozenset({"act"}) if set(model.actuator_dyntype.tolist()) <= FED_BY_COMMAND else frozenset()


def servos(system: MujocoSystem) -> dict[str, tuple[str, ...]]:
    """Joint -> its actuators whose bias pulls against their position, of joints that have one."""
    model, own = system.model, system.joint_actuators
    holding = [a for a in own if a.affine_bias and model.actuator_biasprm[a.actuator, 1] < 0]
    at = {
        name: tuple(model.actuator(a.actuator).name for a in holding if a.joint == model.joint(name).id)
        for name in joint_kinds(model)
    }
    return {name: actuators for name, actuators in at.items() if actuators}


def integrating_commands(system: MujocoSystem) -> tuple[str, ...]:
    """Commands of actuators that integrate them."""
    kinds = system.model.actuator_dyntype
    return tuple(one.name for one in system.commands if int(kinds[one.actuator]) in INTEGRATING)
