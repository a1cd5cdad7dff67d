"""Which effects to try at which targets, and how far each may go: bounds from what the measurements themselves show.

    I    = dt / (d v / d f)        effective inertia, from one step of the simulator with and without a unit load
    F    = max(I max abs(dv/dt), I max abs(u) (d v / d u) / dt)      largest force in play at the joint

The joint's speed and travel are the measured ones (smoothed); the longest dead time is a tenth of the horizon.
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.criticism.windows import Windows, joint_names
from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.effects import EFFECTS, ConstantLoad, Effect, Scales

DEAD_TIME = 0.1  # of the horizon


@dataclass(frozen=True)
class Trial:
    """One point at which a candidate is tried by screening.

    Args:
        candidate: index of the effect.
        values: short name -> value [SI].
        two_sided: whether its size may also have the other sign.
        reach: by which its first parameter differs from neutral [SI].
    """

    candidate: int
    values: dict[str, float]
    two_sided: bool
    reach: float


def propose(simulator: Simulator, windows: Windows, wanted: str | Sequence[str | Effect] = "all") -> tuple[Effect, ...]:
    """The effects to try, without those that the simulator carries already.

    Args:
        simulator: with its parameters' bounds.
        windows: the fit windows, from which bounds are taken.
        wanted: ``"all"``, or names, ``name@target`` keys and effects with bounds of their own.

    Raises:
        BadInput: an unknown effect or target.
    """
    measured = tuple(simulator.signals[i] for i in windows.columns)
    targets = {"joint": joint_names(simulator), "actuator": tuple(simulator.commands), "signal": measured}
    listed = list(EFFECTS) if isinstance(wanted, str) and wanted == "all" else wanted
    if isinstance(listed, str):
        listed = [listed]
    scales: dict[tuple[str, str], Scales] = {}
    found: dict[str, Effect] = {}
    for item in listed:
        if isinstance(item, Effect):
            found[item.key] = item
            continue
        name, _, target = item.partition("@")
        if name not in EFFECTS:
            near = difflib.get_close_matches(name, EFFECTS, n=3, cutoff=0.4)
            raise BadInput(f"effect '{name}' is unknown", f"nearest: {', '.join(near or EFFECTS)}")
        kind = EFFECTS[name].target_kind
        if target and target not in targets[kind]:
            near = difflib.get_close_matches(target, targets[kind], n=3, cutoff=0.4)
            raise BadInput(
                f"'{item}': the simulator has no {kind} '{target}'", f"nearest: {', '.join(near or targets[kind])}"
            )
        for place in (target,) if target else targets[kind]:
            if (kind, place) not in scales:
                scales[kind, place] = target_scales(simulator, windows, kind, place)
            effect = EFFECTS[name].scaled(place, scales[kind, place])
            if target or _carries(simulator, effect):
                found.setdefault(effect.key, effect)
    present = {effect.key for effect in simulator.effects}
    return tuple(effect for key, effect in found.items() if key not in present)


def _carries(simulator: Simulator, effect: Effect) -> bool:
    """Whether the simulator takes the effect: what nobody named need not fit (heat of a muscle, say)."""
    if effect.key in {present.key for present in simulator.effects}:
        return False
    try:
        simulator.with_effect(effect)
    except BadInput:
        return False
    return True


def target_scales(simulator: Simulator, windows: Windows, kind: str, target: str) -> Scales:
    """Typical sizes at a joint, an actuator or a signal, from the measurements and one step of the simulator."""
    joints = joint_names(simulator)
    time = DEAD_TIME * windows.horizon
    if kind == "actuator":
        column = simulator.commands.index(target)
        return Scales(
            force=max(float(windows.command[..., column].abs().max()), 1e-9), speed=1.0, travel=1.0, time=time
        )
    if kind == "signal":
        return _signal_scales(simulator, windows, target, time)
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
    )


def _signal_scales(simulator: Simulator, windows: Windows, target: str, time: float) -> Scales:
    """Range of what was measured of a signal."""
    s = windows.columns.index(simulator.signals.index(target))
    values = windows.value[..., s][windows.measured[..., s]]
    travel = float(values.max() - values.min()) if len(values) else 0.0
    kind = simulator.joint_kinds.get(target.partition(".")[2], "hinge")
    return Scales(force=1.0, speed=1.0, travel=max(travel, 1e-9), time=time, unit=kind)


def trials(effects: Sequence[Effect]) -> tuple[Trial, ...]:
    """Where screening tries each candidate: a small step from neutral, and its own finite starting values."""
    found = []
    for k, effect in enumerate(effects):
        first = effect.parameters.names[0]
        bounds, neutral = effect.parameters[first], effect.neutral[first]
        two_sided = bounds.low < neutral < bounds.high
        step = 1e-3 * (bounds.high - bounds.low)
        step = step if neutral + step <= bounds.high else -step
        found.append(Trial(k, {**effect.neutral, first: neutral + step}, two_sided, step))
        for start in effect.starts:
            found.append(Trial(k, dict(start), two_sided, start[first] - neutral))
    return tuple(found)


def grown(simulator: Simulator, effects: Sequence[Effect]) -> Simulator:
    """The simulator with all these effects."""
    for effect in effects:
        simulator = simulator.with_effect(effect)
    return simulator


def grown_theta(
    simulator: Simulator, theta: Float[Tensor, " P"], effects: Sequence[Effect], trial: Trial | None = None
) -> Float[Tensor, " Q"]:
    """Theta of :func:`grown` with every new effect neutral, except the one that the trial moves."""
    values = list(theta.unbind())
    for k, effect in enumerate(effects):
        own = {**effect.neutral, **(trial.values if trial is not None and trial.candidate == k else {})}
        values += [theta.new_tensor(own[name]) for name in effect.parameters]
    return torch.stack(values) if values else theta


def _motion(simulator: Simulator, windows: Windows, j: int) -> tuple[Tensor, float, float]:
    """Positions visited, largest speed and acceleration of joint j, from averages over bins."""
    s = windows.columns.index(simulator.signals.index(f"qpos.{joint_names(simulator)[j]}"))
    seen = windows.observed[..., s].unflatten(1, (windows.bins, windows.bin_rows)).any(2)
    q, dt = windows.bin(windows.value)[..., s], windows.bin_step
    # A wide difference keeps the sensor's noise out.
    k = max(1, min(windows.bins // 20, (windows.bins - 1) // 4))
    v = (q[:, k:] - q[:, :-k]) / (k * dt)
    a = (v[:, k:] - v[:, :-k]) / (k * dt)
    both = seen[:, k:] & seen[:, :-k]
    triple = both[:, k:] & both[:, :-k]
    speed = float(v.abs()[both].max()) if bool(both.any()) else 0.0
    acceleration = float(a.abs()[triple].max()) if bool(triple.any()) else 0.0
    position = q[seen] if bool(seen.any()) else windows.start[:, j]
    return position, speed, acceleration


def _one_step(simulator: Simulator, windows: Windows, j: int) -> tuple[float, float]:
    """Effective inertia of joint j at a window's start, and the acceleration that the largest commands give it."""
    joint, J = joint_names(simulator)[j], windows.free.shape[1]
    key = f"constant_load@{joint}"
    loaded = simulator
    if key not in {effect.key for effect in simulator.effects}:
        loaded = simulator.with_effect(ConstantLoad.scaled(joint, Scales(1.0, 1.0, 1.0, 1.0)))
    theta = torch.cat([simulator.nominal, loaded.nominal[len(simulator.nominal) :]]).to(windows.start)
    bound = loaded.parameters[f"{key}.load"]
    load, U = min(1e-3 * (bound.high - bound.low), bound.high), len(simulator.commands)
    worlds = theta.expand(2 + U, -1).clone()
    worlds[1, loaded.parameters.index(f"{key}.load")] += load
    dt = simulator.timestep
    start = windows.start[0].expand(2 + U, -1)
    state = TensorDict({"qpos": start[:, :J], "qvel": torch.zeros_like(start[:, J:])}, batch_size=(2 + U,))
    largest = windows.command.abs().amax((0, 1))
    command = torch.cat([torch.zeros(2, U).to(start), torch.diag(largest)])[:, None]
    inputs = TensorDict({"command": command}, batch_size=(2 + U, 1))
    v = loaded.rollout(worlds, state, inputs, worlds.new_tensor([dt]))["qvel"][:, 0, j]
    response = float(v[1] - v[0])
    inertia = load * dt / response if response > 0 else 1.0
    drive = float((v[2:] - v[0]).abs().max()) / dt if U else 0.0
    return inertia, drive
