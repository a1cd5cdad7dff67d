"""``[model_edit] weld``: bodies lose their joints and stay where the file puts them, as a gripper that nobody logged.

Actuators, sensors, equalities and tendons whose joints are all gone go too, and keyframes: they hold positions of the
joints that are gone. What needs another joint as well is the model's, and refused.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import mujoco

from onlinebayes.runs import BadInput, nearest
from onlinebayes.simulators.mujoco.model import compile_spec

ON_JOINTS = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
PAIRED = {mujoco.mjtEq.mjEQ_JOINT: "joint", mujoco.mjtEq.mjEQ_TENDON: "tendon"}
OBSERVED = {
    mujoco.mjtObj.mjOBJ_JOINT: "joint",
    mujoco.mjtObj.mjOBJ_TENDON: "tendon",
    mujoco.mjtObj.mjOBJ_ACTUATOR: "actuator",
}


def weld(spec: mujoco.MjSpec, bodies: Sequence[str]) -> None:
    """Take the joints of some bodies away.

    Args:
        spec: is changed.
        bodies: names.

    Raises:
        BadInput: a body that is not there or has no joint, a joint that something else of the model needs.
    """
    if not bodies:
        return
    joints = {name: _joints(spec, name) for name in bodies}
    gone = {joint.name: name for name, own in joints.items() for joint in own if joint.name}
    for kind, element, needed in [*needing_joints(spec)]:
        if needed & {*gone} and (more := needed - {*gone}):
            joint = min(needed & {*gone})
            what = f"{kind} '{element.name}'" if element.name else f"a nameless {kind}"
            problem = f"body '{gone[joint]}' cannot lose its joint '{joint}', which {what} ties to '{min(more)}'"
            raise BadInput(problem, "weld the body of that joint too, or take that out of the MJCF first")
        if needed & {*gone}:
            spec.delete(element)
    for own in joints.values():
        for joint in own:
            spec.delete(joint)
    for key in list(spec.keys):
        spec.delete(key)
    compile_spec(spec)


def needing_joints(spec: mujoco.MjSpec) -> Iterator[tuple[str, Any, set[str]]]:
    """Kind, element and joints of all that cannot be without some; what stands on an element comes before it."""
    known: dict[str, Mapping[str, set[str]]] = {"joint": {joint.name: {joint.name} for joint in spec.joints}, "": {}}
    tendons = [(tendon, _wrapped(tendon)) for tendon in spec.tendons]
    known["tendon"] = {tendon.name: needed for tendon, needed in tendons}
    actuators = [(actuator, known[_transmission(actuator)].get(actuator.target, set())) for actuator in spec.actuators]
    known["actuator"] = {actuator.name: needed for actuator, needed in actuators}
    for sensor in spec.sensors:
        yield "sensor", sensor, known[OBSERVED.get(sensor.objtype, "")].get(sensor.objname, set())
    for pair in spec.equalities:
        ends = known[PAIRED.get(pair.type, "")]
        yield "equality", pair, ends.get(pair.name1, set()) | ends.get(pair.name2, set())
    yield from (("actuator", *one) for one in actuators)
    yield from (("tendon", *one) for one in tendons)


def _joints(spec: mujoco.MjSpec, name: str) -> list[Any]:
    """A body's joints."""
    body = spec.body(name)
    if body is None or name == "world":
        named = [one.name for one in spec.bodies if one.name and one.name != "world"]
        raise BadInput(f"the model has no body '{name}'", nearest(name, named))
    if not (joints := list(body.joints)):
        raise BadInput(f"body '{name}' has no joint of its own", "it is welded already")
    return joints


def _wrapped(tendon: Any) -> set[str]:
    """The joints that a tendon pulls; of one over sites none."""
    return {wrap.target.name for wrap in tendon.path if wrap.type == mujoco.mjtWrap.mjWRAP_JOINT}


def _transmission(actuator: Any) -> str:
    """What an actuator pulls, where that has joints."""
    if actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON:
        return "tendon"
    return "joint" if actuator.trntype in ON_JOINTS else ""
