"""The words of a column's name, and what those beside a joint's or an actuator's name say.

    LeftKneePos_deg  -> left, knee, pos, deg           motor_state[0].q -> motor, state, 0, q

Some words mean another thing behind others: ``d`` behind a quantity is what is desired (``q_d``, ``tau_J_d``),
``current`` before a position or a speed is the present one and no electric current.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

KINDS = {
    "qpos": {"qpos", "q", "pos", "position", "positions", "angle", "angles", "theta", "displacement"},
    "qvel": {"qvel", "qd", "dq", "qdot", "dtheta", "vel", "velocity", "velocities", "speed", "omega", "rate"},
    "ctrl": {
        *("ctrl", "cmd", "cmds", "command", "commands", "commanded", "control", "u", "input", "inputs", "drive"),
        *("setpoint", "sp", "demand", "action", "actions"),
    },
}
"""Words for a position, a speed, and what an actuator is told."""
GOALS = {"target", "targets", "tgt", "goal", "ref", "reference", "desired", "des", "leader"}
"""Words for what a servo is to reach; they say as little as a quantity for an actuator that is none."""
ORDERS = (GOALS | KINDS["ctrl"]) - {"u", "input", "inputs", "drive", "control"}
"""Beside these a word of position or speed says what a servo is told, not what was measured."""
READINGS = {
    *("actual", "measured", "meas", "measurement", "feedback", "fb", "present", "observed", "follower", "reading"),
    *("observation", "obs", "sensor", "encoder"),
}
"""Words for what was measured, whatever it is."""
QUANTITIES = {
    *("pwm", "duty", "torque", "torques", "moment", "effort", "efforts", "voltage", "volt", "volts", "force", "tau"),
    *("thrust", "current", "amp", "amps", "ampere", "amperes"),
}
"""Words for the input or output of an actuator: a command where nothing better is there."""
UNIT_OF_A_COMMAND = {f"{times}{unit}" for unit in ("A", "V", "Nm", "nm") for times in ("", "m", "k")}
"""Units of such quantities, which are letters of many other names (``v`` is a speed)."""
NO_COMMAND = {
    *("temp", "temperature", "temperatures", "battery", "index", "idx", "seq", "sequence", "counter", "count", "row"),
    *("id", "status", "state", "flag", "mode"),
}
"""Words of columns that are in many logs and tell no actuator anything."""
FOREIGN = {
    *(NO_COMMAND - {"state"}),
    *("acc", "accel", "acceleration", "accelerations", "qacc", "qdd", "ddq", "jerk", "error", "err", "offset", "bias"),
    *("limit", "limits", "min", "max", "lower", "upper", "std", "var", "cov", "covariance", "kp", "kd", "ki", "gain"),
    *("gains", "stiffness", "damping", "inertia", "mass", "tcp", "pose", "ee", "eef", "cartesian", "wrench", "imu"),
    *("gyro", "gyroscope", "mag", "magnetometer", "reward", "done", "image", "images", "camera", "home"),
    *("enable", "enabled", "time", "stamp", "name", "power", "energy", "pressure", "lost"),
}
"""Words of columns that are neither the position nor the speed of a joint, nor what an actuator is told."""
SILENT = {
    *("joint", "joints", "jnt", "dof", "dofs", "motor", "motors", "actuator", "actuators", "axis", "data", "field"),
    *("state", "states", "robot", "arm", "j", "value", "values", "main", "msg", "servo", "low", "rt", "lowstate"),
    *("lowcmd", "jointstate", "jointstates", "controller", "est", "estimate", "estimated"),
}
"""Words that say nothing of which joint is meant, nor what of it."""
SWITCHES = {"enable", "enabled"}
ESTIMATES = {"est", "estimate", "estimated"}


@dataclass(frozen=True)
class Said:
    """What the words beside a name say.

    Args:
        position: a word of position is among them.
        speed: one of speed.
        push: a torque, a current, a duty cycle.
        told: a word of what an actuator is told, sure for any actuator.
        goal: a word of what a servo is to reach.
        order: a word beside which a quantity is what is told.
        measured: a word of what was measured.
        foreign: a word of something else.
        unknown: how many words say nothing that is known.
    """

    position: bool
    speed: bool
    push: bool
    told: bool
    goal: bool
    order: bool
    measured: bool
    foreign: bool
    unknown: int


def words(column: str) -> list[str]:
    """``LeftKneePos_deg`` -> ``["left", "knee", "pos", "deg"]``."""
    parts = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", column.replace("°", " deg "))
    return [part.lower() for part in parts]


def ends_in_unit(column: str) -> bool:
    """Check whether one of a column's words is a unit of what an actuator that is no servo is told: ``coil_A``."""
    return bool(UNIT_OF_A_COMMAND & {*re.split(r"[^A-Za-z]+", column)})


def said_by(beside: Sequence[str], units: Collection[str] = ()) -> Said:
    """What these words say together; ``units`` are words for units, which are known and say no quantity."""
    spoken = _in_context(beside)
    have = set(spoken)
    known = set().union(*KINDS.values(), GOALS, QUANTITIES, READINGS, SILENT, units, {"s", "a", "v", "nm"})
    return Said(
        position=bool(have & KINDS["qpos"]),
        speed=bool(have & KINDS["qvel"]),
        push=bool(have & QUANTITIES),
        told=bool(have & KINDS["ctrl"]),
        goal=bool(have & GOALS),
        order=bool(have & ORDERS),
        measured=bool(have & READINGS) or bool(have & ESTIMATES),
        foreign=bool(have & FOREIGN),
        unknown=sum(word not in known for word in spoken),
    )


def _in_context(said: Sequence[str]) -> list[str]:
    """The words, with those put for what they mean beside the others."""
    moved = KINDS["qpos"] | KINDS["qvel"]
    spoken = list(said)
    for k, word in enumerate(said):
        after = next((later for later in said[k + 1 :] if later not in SILENT), "")
        if word == "d" and set(said[:k]) & (moved | QUANTITIES):
            spoken[k] = "desired"
        if word in ("current", "curr") and after in moved:
            spoken[k] = "actual"
    return spoken
