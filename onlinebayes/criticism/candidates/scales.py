"""Characteristic scales at a target (inertia, force, speed, time), which set an effect's bounds and trial values.

    I    = dt / (d v / d f)        effective inertia, from one step of the simulator with and without a load
    F    = max(I max abs(dv/dt), I max abs(u) (d v / d u) / dt)      largest force in play at the joint

The joint's speed and travel are the measured ones (smoothed); the longest dead time is a tenth of the horizon. A
body's sizes are its mass and extent, an actuator's its largest command and the largest force that it gives while the
nominal model replays the windows: a servo's goal, times its stiffness, says little about that.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.identification.data.motion import SeenBy, seen_by
from onlinebayes.identification.data.windows import Windows, joint_names
from onlinebayes.identification.replaying.replay import rollout
from onlinebayes.identification.replaying.scoped import unscoped
from onlinebayes.identification.replaying.timed import instants
from onlinebayes.simulators.abilities import Extensible, Measured
from onlinebayes.simulators.effects import ConstantLoad, Scales, TargetKind
from onlinebayes.simulators.identifiable import Identifiable

DEAD_TIME = 0.1  # of the horizon
ROOM = 1.25  # times the force of a replay, where the force depends on the motion
LOADS = (1.0, 1e1, 1e2, 1e3, 1e4, 1e5)  # times the smallest force by which a joint's inertia is measured
HELD = 1.1  # inertia by the smallest force over the least one, above which something holds the joint


def target_scales(
    simulator: Identifiable,
    windows: Windows,
    kind: TargetKind,
    target: str,
    forces: Float[Tensor, " U"] | None = None,
) -> Scales:
    """Typical sizes at a target, from the measurements and one step of the simulator.

    Args:
        simulator, windows: the model, and what it is to be fitted on.
        kind, target: of what.
        forces: :func:`largest_forces` where they are known; they take a replay.
    """
    joints = joint_names(simulator)
    time = DEAD_TIME * windows.horizon
    if kind == "actuator":
        column = simulator.commands.index(target)
        largest = max(float(windows.command[..., column].abs().max()), 1e-9)
        # Which joint it drives is not known here; the slowest one gives the widest bounds.
        driven = [joints.index(joint) for joint in simulator.targets("joint")] or range(len(joints))
        speed = max(min(_motion(simulator, windows, j)[1] for j in driven), 1e-9)
        if forces is None:
            forces = largest_forces(simulator, windows)
        return Scales(force=largest, speed=speed, travel=1.0, time=time, output=float(forces[column]))
    if kind == "signal":
        return _signal_scales(simulator, windows, target, time)
    if kind == "parameter":
        return Scales(1.0, 1.0, 1.0, time, bounds=unscoped(simulator).parameters[target], span=_span(windows))
    if kind == "geom":
        return Scales(force=1.0, speed=1.0, travel=1.0, time=time, contact=simulator.contacts[target])
    if kind in ("body", "site", "world"):
        return _body_scales(simulator, windows, target, time)
    j = joints.index(target)
    position, speed, acceleration = _motion(simulator, windows, j)
    inertia, drive = _one_step(simulator, windows, j)
    force = inertia * max(acceleration, drive)
    travel = float(position.max() - position.min())
    return Scales(
        force=max(force, 1e-9),
        speed=max(speed, 1e-9),
        travel=max(travel, 1e-9),
        time=time,
        unit=simulator.joint_kinds.get(target, "hinge"),
        centre=float(position.max() + position.min()) / 2,
        inertia=inertia,
    )


def largest_forces(simulator: Identifiable, windows: Windows) -> Float[Tensor, " U"]:
    """Largest force of each actuator, before its gear, while the nominal model replays the windows [N, N m].

    Where that depends on the motion, the model's is not quite the machine's, and there is :data:`ROOM` for more. What
    diverged does not count; an actuator that gives nothing has the size of its commands.
    """
    commands = windows.command.abs().amax((0, 1))
    theta, starts = simulator.nominal.to(windows.start)[None], windows.start[None]
    trajectory = rollout(simulator, windows, theta, starts)[0]
    motion = TensorDict(
        {"qpos": trajectory["qpos"], "qvel": trajectory["qvel"], "command": windows.command, "enable": windows.enable},
        batch_size=trajectory.batch_size,
    )
    worlds = theta.expand(windows.count, -1)
    moving = simulator.actuator_forces(worlds, motion, windows.step)
    moving = moving * (trajectory["valid"] & windows.inside)[..., None]
    motion["qpos"], motion["qvel"] = torch.zeros_like(motion["qpos"]), torch.zeros_like(motion["qvel"])
    alone = simulator.actuator_forces(worlds, motion, windows.step) * windows.inside[..., None]
    largest = moving.abs().amax((0, 1))
    largest = torch.where((moving - alone).abs().amax((0, 1)) > 0, ROOM * largest, largest)
    return torch.where(largest > 0, largest, commands).clamp_min(1e-9)


def _body_scales(simulator: Identifiable, windows: Windows, target: str, time: float) -> Scales:
    """Mass and size of a body, or the largest ones of the world; the speed of the moving mass on all joints at once.

    A hinge whose inertia is I moves the mass M at a distance of about sqrt(I / M) from its axis, and a free body turns
    about its own centre.
    """
    sizes, kinds, hinges = simulator.body_sizes, simulator.joint_kinds, simulator.targets("joint")
    if target in sizes:
        mass, length = sizes[target]
    else:
        mass, length = (max((size[k] for size in sizes.values()), default=1.0) for k in (0, 1))
    moving, speed = sum(m for m, _ in sizes.values()) or 1.0, 0.0
    for j, joint in enumerate(joint_names(simulator)):
        distance = 1.0 if kinds.get(joint) == "slide" else length
        if joint in hinges and kinds.get(joint) != "slide":
            distance = max(length, (_one_step(simulator, windows, j)[0] / moving) ** 0.5)
        speed += distance * _motion(simulator, windows, j)[1]
    return Scales(force=1.0, speed=max(speed, 1e-9), travel=1.0, time=time, inertia=mass, length=length)


def _signal_scales(simulator: Extensible, windows: Windows, target: str, time: float) -> Scales:
    """Range of what was measured of a signal."""
    s = windows.columns.index(simulator.signals.index(target))
    values = windows.value[..., s][windows.measured[..., s]]
    travel = float(values.max() - values.min()) if len(values) else 0.0
    kind = simulator.joint_kinds.get(target.partition(".")[2], "hinge")
    return Scales(force=1.0, speed=1.0, travel=max(travel, 1e-9), time=time, unit=kind, span=_span(windows))


def _span(windows: Windows) -> tuple[float, float]:
    """The first and the last instant of what was measured [s]."""
    begin, end = instants(windows)
    return float(begin.min()), float(end.max())


def _motion(simulator: Identifiable, windows: Windows, j: int) -> tuple[Tensor, float, float]:
    """Positions visited, largest speed and acceleration of joint j, from averages over bins."""
    by = seen_in(simulator, windows, joint_names(simulator)[j])
    seen, dt = windows.seen[..., by.column], windows.bin_step
    shown, between = _filled(windows.bin(windows.value)[..., by.column], seen)
    # A wide difference keeps the sensor's noise out.
    k = max(1, min(windows.bins // 20, (windows.bins - 1) // 4))
    if by.position:
        v, moving = (shown[:, k:] - shown[:, :-k]) / (k * dt), between[:, k:] & between[:, :-k]
    else:
        v, moving = shown, between
    a = (v[:, k:] - v[:, :-k]) / (k * dt)
    both = moving[:, k:] & moving[:, :-k]
    speed = float(v.abs()[moving].max()) if bool(moving.any()) else 0.0
    acceleration = float(a.abs()[both].max()) if bool(both.any()) else 0.0
    position = shown[seen] if by.position and bool(seen.any()) else windows.start[:, j]
    return position, speed, acceleration


def _filled(shown: Float[Tensor, "W n"], seen: Bool[Tensor, "W n"]) -> tuple[Float[Tensor, "W n"], Bool[Tensor, "W n"]]:
    """Bins of a sensor slower than they are, filled in linearly; and which lie between two that were seen."""
    place = torch.arange(seen.shape[1], device=seen.device).expand_as(seen)
    before = torch.where(seen, place, -1).cummax(1)[0]
    after = torch.where(seen, place, seen.shape[1]).flip(1).cummin(1)[0].flip(1)
    between = (before >= 0) & (after < seen.shape[1])
    before, after = before.clamp_min(0), after.clamp_max(seen.shape[1] - 1)
    part = (place - before) / (after - before).clamp_min(1)
    return (1 - part) * shown.gather(1, before) + part * shown.gather(1, after), between


def seen_in(simulator: Measured, windows: Windows, joint: str) -> SeenBy:
    """By which of the measured signals the joint is seen."""
    return seen_by(joint, [simulator.signals[column] for column in windows.columns])


def _one_step(simulator: Identifiable, windows: Windows, j: int) -> tuple[float, float]:
    """Effective inertia of joint j at a window's start, and the acceleration that the largest commands give it.

    A joint that its friction or a contact holds hardly answers a small force. Larger ones are tried as well, as long as
    they change its velocity in one step by less than it was seen to move: the one that it answers best tells.
    """
    simulator = unscoped(simulator)
    joint, J = joint_names(simulator)[j], windows.free.shape[1]
    key = f"constant_load@{joint}"
    loaded = simulator
    if key not in {effect.key for effect in simulator.effects}:
        loaded = simulator.with_effect(ConstantLoad.scaled(joint, Scales(1.0, 1.0, 1.0, 1.0)))
    theta = torch.cat([simulator.nominal, loaded.nominal[len(simulator.nominal) :]]).to(windows.start)
    bound = loaded.parameters[f"{key}.load"]
    load, U, M = min(1e-3 * (bound.high - bound.low), bound.high), len(simulator.commands), len(LOADS)
    loads = load * theta.new_tensor(LOADS)
    worlds = theta.expand(1 + M + U, -1).clone()
    worlds[1 : 1 + M, loaded.parameters.index(f"{key}.load")] += loads
    dt = simulator.timestep
    start = windows.start[0].expand(len(worlds), -1)
    state = TensorDict({"qpos": start[:, :J], "qvel": torch.zeros_like(start[:, J:])}, batch_size=(len(worlds),))
    largest = windows.command.abs().amax((0, 1))
    command = torch.cat([torch.zeros(1 + M, U).to(start), torch.diag(largest)])[:, None]
    # A command's force is what it comes to, however long an activation takes for it.
    state.update({key: line[:, 0] for key, line in loaded.command_driven_states(worlds, command, dt).items()})
    inputs = TensorDict({"command": command}, batch_size=(len(worlds), 1))
    v = loaded.rollout(worlds, state, inputs, worlds.new_tensor([dt]))["qvel"][:, 0, j]
    response = v[1 : 1 + M] - v[0]
    inertia = loads * dt / response
    inertia[1:][response[1:] > _motion(simulator, windows, j)[1]] = torch.inf
    inertia[~(response > 0)] = torch.inf
    freest = float(inertia.min())
    if math.isinf(freest):
        freest = 1.0
    elif float(inertia[0]) < HELD * freest:  # nothing holds it, and the smallest force is the most linear
        freest = float(inertia[0])
    drive = float((v[1 + M :] - v[0]).abs().max()) / dt if U else 0.0
    return freest, drive
