"""The effects to try at each target, and their starting values; how far each may go follows from :mod:`.scales`.

All are tried but those that are the same law as another candidate, play behind a motor, and those of so much freedom
that the search tries them when nothing else explains the data (see ``hypotheses.explanation.flexible``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.candidates.scales import largest_forces, seen_in, target_scales
from onlinebayes.identification.data.windows import Windows, joint_names
from onlinebayes.identification.replaying.scoped import effect_entries
from onlinebayes.runs import BadInput, nearest
from onlinebayes.simulators.abilities import Extensible, Measured
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.effects import EFFECTS, Effect, Scales, TargetKind
from onlinebayes.simulators.effects.base import split_axis
from onlinebayes.simulators.identifiable import Identifiable


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


def propose(
    simulator: Identifiable, windows: Windows, wanted: str | Sequence[str | Effect] = "all"
) -> tuple[Effect, ...]:
    """The effects to try, without those that the simulator carries already.

    Args:
        simulator: with its parameters' bounds.
        windows: the fit windows, from which bounds are taken.
        wanted: ``"all"``, or names, ``name@target`` keys and effects with bounds of their own.

    Raises:
        BadInput: an unknown effect or target.
    """
    joint_names(simulator)  # refuses free and ball joints
    all_of_them = isinstance(wanted, str) and wanted == "all"
    vocabulary = {**EFFECTS, **simulator.own_effects}
    listed = list(vocabulary) if all_of_them else wanted
    if isinstance(listed, str):
        listed = [listed]
    scales: dict[tuple[TargetKind, str], Scales] = {}
    forces: Float[Tensor, " U"] | None = None
    found: dict[str, Effect] = {}
    for item in listed:
        if isinstance(item, Effect):
            found[item.key] = item
            continue
        name, _, target = item.partition("@")
        if name not in vocabulary:
            raise BadInput(f"effect '{name}' is unknown", nearest(name, vocabulary))
        kind, axes = vocabulary[name].target_kind, vocabulary[name].axes
        known = _targets(simulator, windows, kind)
        wider = {place: k for k in vocabulary[name].wider for place in simulator.targets(k)}
        if target and split_axis(target, axes)[0] not in (*known, *wider):
            raise BadInput(f"'{item}': the simulator has no {kind} '{target}'", nearest(target, known))
        known = tuple(e for e in known if kind != "geom" or not simulator.contacts[e].covered)
        moving = tuple(element for element in known if not _still(simulator, windows, kind, element))
        every = tuple(f"{element}.{axis}" for element in moving for axis in axes) if axes else moving
        effects = []
        for place in (target,) if target else every:
            element = split_axis(place, axes)[0]
            at = wider.get(element, kind), element
            if at not in scales:
                if at[0] == "actuator" and forces is None:
                    forces = largest_forces(simulator, windows)
                scales[at] = target_scales(simulator, windows, *at, forces)
            effects.append(vocabulary[name].scaled(place, scales[at]))
        placed = [effect for effect in effects if _placed(simulator, windows, effect, bool(target))]
        if all_of_them:
            placed = [
                effect
                for effect in placed
                if not (effect.tried_last or effect.tried_where_lag_grows)
                and not (_unservoed(simulator, effect) or _said(simulator, effect))
            ]
        possible = [effect for effect in placed if target or can_have(simulator, effect)]
        # A name that nothing can have is kept where it was asked for: the simulator says why it cannot.
        for effect in possible if possible or all_of_them else placed:
            found.setdefault(effect.key, effect)
    present = {effect.key for effect in simulator.effects}
    return tuple(effect for key, effect in found.items() if key not in present)


def _unservoed(simulator: Extensible, effect: Effect) -> bool:
    """Check whether the effect is tried at servos and their joints only, and its target is none."""
    servos = simulator.servos
    places = {*servos} if effect.target_kind == "joint" else {name for names in servos.values() for name in names}
    return effect.tried_at_servos and effect.target not in places


def _said(simulator: Extensible, effect: Effect) -> bool:
    """Check whether other candidates say the same with less."""
    kinds = {joint: simulator.joint_kinds.get(joint, "") for joint in joint_names(simulator)}
    return effect.said_by_joints(kinds, simulator.moving_joints.get(effect.element, ()))


def _targets(simulator: Extensible, windows: Windows, kind: TargetKind) -> tuple[str, ...]:
    """Return the targets at which effects of one kind can be tried; of the signals those that were measured."""
    measured = {simulator.signals[i] for i in windows.columns}
    return tuple(name for name in simulator.targets(kind) if kind != "signal" or name in measured)


def _still(simulator: Measured, windows: Windows, kind: TargetKind, element: str) -> bool:
    """Check whether a joint, or a signal's joint, stands still in every window: it shows no effect of its own."""
    joint = {"joint": element, "signal": element.partition(".")[2]}.get(kind, "")
    joints = joint_names(simulator)
    return joint in joints and bool(windows.free.any()) and not bool(windows.free[:, joints.index(joint)].any())


def _placed(simulator: Measured, windows: Windows, effect: Effect, named: bool) -> bool:
    """Check whether the position that the effect depends on, if it does, was measured.

    Raises:
        BadInput: it was not, and the effect was named at this very target.
    """
    if not effect.needs_position or seen_in(simulator, windows, effect.target).position:
        return True
    if named:
        raise BadInput(
            f"{effect.key} depends on the position of '{effect.target}', which was not measured",
            f"add the column qpos.{effect.target}, or leave the effect out",
        )
    return False


def can_have(simulator: Measured, effect: Effect) -> bool:
    """Check whether the simulator can have the effect: what nobody named at a target is passed over where it cannot."""
    try:
        simulator.with_effect(effect)
    except BadInput:
        return effect.key in {other.key for other in simulator.effects}
    return True


def trials(effects: Sequence[Effect]) -> tuple[Trial, ...]:
    """List the points where screening tries each candidate: a small step from neutral, its own finite starts."""
    found = []
    for k, effect in enumerate(effects):
        first = effect.magnitude
        bounds, neutral = effect.parameters[first], effect.neutral[first]
        two_sided = bounds.low < neutral < bounds.high
        step = 1e-3 * (bounds.high - bounds.low)
        step = step if neutral + step <= bounds.high else -step
        found.append(Trial(k, {**effect.neutral, first: neutral + step}, two_sided, step))
        for start in effect.starts:
            found.append(Trial(k, dict(start), two_sided, start[first] - neutral))
    return tuple(found)


def grown(simulator: Identifiable, effects: Sequence[Effect]) -> Identifiable:
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
        values += [theta.new_tensor(own[name]) for name in effect_entries(simulator, effect).values()]
    return torch.stack(values) if values else theta
