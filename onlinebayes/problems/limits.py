"""The ``[next]`` of a problem file: what the user allows in the next recording."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from onlinebayes.criticism import Allowed, Payload
from onlinebayes.identification import joint_names
from onlinebayes.problems.section import Section
from onlinebayes.runs import BadInput
from onlinebayes.simulators.abilities import Editable
from onlinebayes.simulators.identifiable import Identifiable

KEYS = ("max_command", "max_rate", "travel", "max_speed", "seconds", "payload")


def read_allowed(top: Section, simulator: Identifiable) -> Allowed:
    """The user's own limits; none where the file has no ``[next]``.

    Args:
        top: the problem file.
        simulator: gives the names of actuators and joints.

    Raises:
        BadInput: no actuators, an unknown key or name, or a value that limits nothing or everything.
    """
    if not simulator.commands:
        raise top.error("model", "it has no actuators", "there is no command to propose: add an actuator to the model")
    section = top.section("next", KEYS)
    joints = joint_names(simulator)
    seconds = section.number("seconds")
    if seconds is not None:
        _positive(section, "seconds", seconds)
    return Allowed(
        _sizes(section, "max_command", simulator.commands),
        _sizes(section, "max_rate", simulator.commands),
        _travel(section, joints),
        _sizes(section, "max_speed", joints),
        seconds,
        _payload(section, simulator),
    )


def _sizes(section: Section, key: str, names: Sequence[str]) -> dict[str, float]:
    """A positive number for all, or a table name -> positive number."""
    value = section.values.get(key, {})
    if not isinstance(value, dict):
        return dict.fromkeys(names, _positive(section, key, section.finite(key, value)))
    table = section.section(key, names)
    return {name: _positive(table, name, table.finite(name, size)) for name, size in table.values.items()}


def _travel(section: Section, joints: Sequence[str]) -> dict[str, tuple[float, float]]:
    """``[low, high]`` for all joints, or a table joint -> ``[low, high]``."""
    value = section.values.get("travel", {})
    if not isinstance(value, dict):
        return dict.fromkeys(joints, _range(section, "travel", value))
    table = section.section("travel", joints)
    return {joint: _range(table, joint, bounds) for joint, bounds in table.values.items()}


def _range(section: Section, key: str, value: Any) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise section.error(key, f"{value!r} is no pair of bounds", "write [low, high] in SI units")
    low, high = (section.finite(key, edge) for edge in value)
    if not low < high:
        raise section.error(key, f"[{low:g}, {high:g}] holds no position", "write the lower one first")
    return low, high


def _payload(section: Section, simulator: Editable) -> Payload | None:
    if "payload" not in section:
        return None
    table = section.section("payload", ("body", "mass"))
    mass = table.number("mass")
    if mass is None:
        raise table.error("mass", "missing", "give the mass in kg")
    payload = Payload(table.text("body"), _positive(table, "mass", mass))
    try:
        simulator.with_payload(payload.body, payload.mass)
    except BadInput as error:
        raise table.error("body", str(error)) from None
    return payload


def _positive(section: Section, key: str, value: float) -> float:
    if not value > 0:
        raise section.error(key, f"{value:g} is not above zero", "give a positive number")
    return value
