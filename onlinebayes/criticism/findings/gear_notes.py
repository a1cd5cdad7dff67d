"""Limits of an actuator's force stand before its gear: what they are behind it, where the gear is not 1.

force on the joint or tendon = gear f,      abs(f) <= limit
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import mujoco

from onlinebayes.criticism.results import Candidate
from onlinebayes.identification.replaying.scoped import effect_values, physical
from onlinebayes.identification.replaying.wrapper import unwrap
from onlinebayes.identification.results import FittedModel
from onlinebayes.simulators.effects import ActuatorSaturation
from onlinebayes.simulators.mujoco import MujocoSimulator

LIMIT = "limit"
UNITS = {int(mujoco.mjtJoint.mjJNT_SLIDE): "N", int(mujoco.mjtJoint.mjJNT_HINGE): "N m"}
JOINTS = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))


def gear_notes(final: FittedModel, candidates: Sequence[Candidate]) -> Iterator[str]:
    """A sentence for each limit of force, fitted or ranked, of an actuator whose gear is not 1.

    Args:
        final: the accepted model; its gear may be a fitted one.
        candidates: as ranked.
    """
    simulator = unwrap(final.simulator)
    if not isinstance(simulator, MujocoSimulator):
        return
    theta, model = physical(final.simulator, final.theta), simulator.model
    gears = simulator.fields(theta[None].cpu().numpy()).get("actuator_gear", model.actuator_gear[None])[0, :, 0]
    for key, limit in _limits(final, candidates).items():
        actuator = int(model.actuator(key.partition("@")[2]).id)
        gear, unit = float(gears[actuator]), _unit_behind(model, actuator)
        if unit and abs(gear) != 1.0:
            yield (
                f"{key}.{LIMIT} is the actuator's own force, before its gear of {gear:.4g}: "
                f"{limit:.3g} there is {abs(gear) * limit:.3g} {unit} behind it"
            )


def _limits(final: FittedModel, candidates: Sequence[Candidate]) -> dict[str, float]:
    """Key of the effect -> its limit, fitted with the final model, or for a rank."""
    name = f"{ActuatorSaturation.name}@"
    ranked = {c.effect: c.parameters[LIMIT].mean for c in candidates if LIMIT in c.parameters}
    fitted = {
        effect.key: values[LIMIT]
        for effect in final.simulator.effects
        if LIMIT in (values := effect_values(final.simulator, final.theta, effect))
    }
    return {key: limit for key, limit in {**ranked, **fitted}.items() if key.startswith(name)}


def _unit_behind(model: mujoco.MjModel, actuator: int) -> str:
    """Unit of the force on what it drives; empty where its gear is more than one number."""
    kind, driven = int(model.actuator_trntype[actuator]), int(model.actuator_trnid[actuator, 0])
    if kind == int(mujoco.mjtTrn.mjTRN_TENDON):
        return "N"
    return UNITS.get(int(model.jnt_type[driven]), "") if kind in JOINTS else ""
