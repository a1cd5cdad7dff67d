"""The numbers of a model that may be off: what a data sheet or a drawing said, and nobody measured on this machine.

| number                                  | bounds                                                     |
|-----------------------------------------|------------------------------------------------------------|
| mass, principal moments of a body       | 30 % to either side                                        |
| centre of mass of a body, along an axis | 30 % of the body's size to either side                     |
| gear of an actuator, kp and kv of a servo | 50 % to either side                                      |
| damping, dry friction, stiffness, armature of a joint | none at all to three times as much           |

Passive terms reach down to nothing: a model may have what the machine lacks. A term that the model has not got is an
effect, and none of its numbers.
"""

from __future__ import annotations

from collections.abc import Iterator

import mujoco

from onlinebayes.parameters import Parameter
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco.addresses import names, resolve
from onlinebayes.simulators.mujoco.inventory import body_sizes, joint_kinds

INERTIAL = 0.3
"""Share by which masses, moments and centres of mass are off at most: more is another machine."""

DRIVE = 0.5
"""Share by which a drive's constants are off at most."""

PASSIVE = 3.0
"""Times as much of a passive term as the model has, at most."""


def own_numbers(model: mujoco.MjModel) -> dict[str, Parameter]:
    """Address -> how far it may be off, of every number that is not nothing."""
    return {address: bounds for address, bounds in _numbers(model) if bounds is not None}


def _numbers(model: mujoco.MjModel) -> Iterator[tuple[str, Parameter | None]]:
    for body, (_, size) in body_sizes(model).items():
        yield from ((f"body.{body}.{field}", _share(model, f"body.{body}.{field}", INERTIAL)) for field in _INERTIAL)
        for k in range(3):
            value = resolve(model, f"body.{body}.ipos[{k}]").read(model)
            yield f"body.{body}.ipos[{k}]", Parameter(value - INERTIAL * size, value + INERTIAL * size, "m")
    for joint in joint_kinds(model):
        for field in ("damping", "frictionloss", "stiffness", "armature"):
            yield f"joint.{joint}.{field}", _passive(model, f"joint.{joint}.{field}")
    for actuator in filter(None, names(model, "actuator")):
        for field in ("gear[0]", "kp", "kv"):
            yield f"actuator.{actuator}.{field}", _share(model, f"actuator.{actuator}.{field}", DRIVE)


_INERTIAL = ("mass", "inertia[0]", "inertia[1]", "inertia[2]")


def _share(model: mujoco.MjModel, name: str, share: float) -> Parameter | None:
    try:
        address = resolve(model, name)
    except BadInput:  # the actuator is no servo
        return None
    value = address.read(model)
    ends = sorted((value * (1 - share), value * (1 + share)))
    return Parameter(ends[0], ends[1], address.unit) if value else None


def _passive(model: mujoco.MjModel, name: str) -> Parameter | None:
    address = resolve(model, name)
    value = address.read(model)
    return Parameter(0.0, PASSIVE * value, address.unit) if value > 0 else None
