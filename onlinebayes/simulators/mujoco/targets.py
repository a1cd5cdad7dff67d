"""Checks that an effect can act at its target: an element that exists, that moves, and whose law is known."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput, nearest
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.mujoco.actuation import JointActuator
from onlinebayes.simulators.mujoco.addresses import (
    HINGE,
    SLIDE,
    element_id,
    movable_body,
    movable_site,
    names,
    scalar_joint,
)
from onlinebayes.simulators.mujoco.columns import signals
from onlinebayes.simulators.mujoco.native import native
from onlinebayes.simulators.mujoco.native.contacts import touching


def check_target(model: mujoco.MjModel, effect: Effect, sensors: Sequence[str], parameters: ParameterSpace) -> None:
    """Check an effect's target.

    Args:
        model: without effects.
        effect: whose target is checked.
        sensors: signals that sensors give.
        parameters: the free ones.

    Raises:
        BadInput: there is no such element, it does not move, or the effect has no form in MuJoCo.
    """
    if "world" in effect.wider and effect.element == "world":
        pass
    elif effect.target_kind == "joint":
        scalar_joint(model, effect.target)
    elif effect.target_kind in ("signal", "parameter"):
        known = (*signals(model), *sensors) if effect.target_kind == "signal" else parameters.names
        if effect.target not in known:
            problem = f"{effect.target_kind} '{effect.target}' of {effect.key} is unknown"
            raise BadInput(problem, nearest(effect.target, known))
        return
    elif effect.target_kind == "body":
        at_site = "site" in effect.wider and effect.element not in names(model, "body")
        (movable_site if at_site and effect.element in names(model, "site") else movable_body)(model, effect.element)
    elif effect.target_kind == "geom":
        touching(model, effect.target)
    elif effect.target_kind == "world":
        if effect.element != "world":
            raise BadInput(f"{effect.key} acts on the whole world", f"write {effect.name}@world")
    else:
        actuator = element_id(model, "actuator", effect.target)
        if effect.has_command and not native(effect) and model.actuator_ctrlnum[actuator] != 1:
            raise BadInput(f"{effect.key}: the actuator has several commands", "an input stage acts on a single one")
    if not (native(effect) or effect.has_command or effect.has_force):
        raise BadInput(f"{effect.key} has no form in MuJoCo", "write its command() or its force(), or add it to NATIVE")


def check_staged(model: mujoco.MjModel, actuators: Sequence[JointActuator], effect: Effect) -> None:
    """Check that an effect of the force stage finds a joint, and the law of its actuators where it needs that.

    Args:
        model: with all effects.
        actuators: those that act on joints.
        effect: of the force stage.

    Raises:
        BadInput: it does not.
    """
    if effect.target_kind == "actuator":
        mine = [a for a in actuators if a.actuator == model.actuator(effect.target).id]
        if not mine or int(model.jnt_type[mine[0].joint]) not in (int(SLIDE), int(HINGE)):
            raise BadInput(f"{effect.key}: the actuator drives no slide or hinge joint", "use an actuator of a joint")
        if effect.bounds_friction:
            raise BadInput(f"{effect.key}: dry friction acts on a joint", "give it a joint as target")
    else:
        mine = [a for a in actuators if a.joint == model.joint(effect.target).id]
    if effect.needs_drive:
        for actuator in mine:
            actuator.check(model, effect.key)
    if effect.needs_servo:
        if len(mine) != 1:
            raise BadInput(f"{effect.key}: joint '{effect.target}' has {len(mine)} actuators", "it needs a single one")
        mine[0].check(model, effect.key)
