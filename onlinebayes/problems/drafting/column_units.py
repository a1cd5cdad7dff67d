"""Units that the name of a column says: ``hip_deg``, ``belt_speed_mm/s``, ``drive torque [mN m]``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise

from onlinebayes.measurements.units import SI
from onlinebayes.problems.drafting.words import words

UNITS = {word: word for word in ("mm", "cm", "um", "deg", "rev", "mrad", "rpm")} | {"degrees": "deg", "degree": "deg"}
OF_KIND = {"qpos": {"mm", "cm", "um", "deg", "rev", "mrad"}, "qvel": {"rpm"}}
OF_PUSHES = ("N", "N m", "V", "A")
"""SI units of what an actuator is told that is no servo."""
OF_POSITIONS = OF_KIND["qpos"] | {"m", "rad"}
UNIT_WORDS = {*UNITS, *OF_POSITIONS, "rads", "radian", "radians"}
UNKNOWN_UNITS = {"counts", "ticks", "raw", "adc", "lsb", "grad", "gon"}
"""Words for numbers whose size in SI nobody can tell by the name."""
SECOND = {"s", "sec", "secs", "second", "seconds"}
PER_SECOND = {unit for unit in OF_KIND["qpos"] if f"{unit}/s" in SI}


def is_rate(said: Sequence[str]) -> bool:
    """Check whether the words have the unit of a speed: ``rpm``, or a unit of a position before seconds (``deg_s``)."""
    return "rpm" in said or any(unit in OF_POSITIONS and of in SECOND for unit, of in pairwise(said))


def has_foreign_unit(kind: str, column: str, said: Sequence[str]) -> bool:
    """Check whether the unit in a column's name is of another quantity, or one that cannot be turned into SI."""
    if kind == "qpos" and is_rate(said):
        return True
    unread = kind == "qvel" and any(word in UNITS for word in said) and not unit_of(kind, column)
    return kind != "ctrl" and (unread or bool(UNKNOWN_UNITS & {*said}))


def unit_of(kind: str, column: str) -> str:
    """The unit that a column's name says for a ``qpos``, ``qvel`` or ``ctrl``; empty for SI."""
    if kind == "ctrl":
        end = re.search(r"(?:^|[\W_])([a-zA-Z]+(?: m)?)\W*$", column)
        si, factor = SI.get(end[1] if end else "", ("", 1.0))
        return end[1] if end and si in OF_PUSHES and factor != 1.0 else ""
    said = [UNITS[word] for word in words(column) if word in UNITS]
    if not said:
        return ""
    if kind == "qvel" and said[-1] in PER_SECOND:
        return f"{said[-1]}/s"
    return said[-1] if said[-1] in OF_KIND.get(kind, ()) else ""
