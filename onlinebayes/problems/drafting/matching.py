"""Columns of a log -> the model's signals and commands: exact names first, then names that say the same.

A column is cut into words (``LeftKneePos_deg`` -> left, knee, pos, deg). It is proposed for ``qpos.left_knee`` when it
holds every word of the joint's name and a word for position, or no word for another kind; where the model has a single
joint (or actuator) its name may be missing. What fits best is taken, each column once, nothing by chance: a column that
fits two names equally well is left out, until what it rivals is taken. The clock's column is found by its name alone.

For a command a word of what was told (``cmd``, ``target``) counts more than one of what then flows or pushes
(``current``), which may be a measurement; beside it, a word of position or speed is no other kind's where the actuator
is told one; a unit alone (``coil_A``) counts beside the actuator's name. Two guesses come last and are called so: a
column with exactly an actuator's name that no joint claims, and the one column left for the one actuator or joint left.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from onlinebayes.measurements.units import SI

KINDS = {
    "qpos": {"qpos", "q", "pos", "position", "angle", "theta", "displacement", "encoder"},
    "qvel": {"qvel", "qd", "dq", "vel", "velocity", "speed", "omega", "rate"},
    "ctrl": {
        "ctrl",
        "cmd",
        "command",
        "control",
        "u",
        "input",
        "drive",
        "setpoint",
        "demand",
        "action",
    },
}
GOALS = {"target", "goal", "ref", "reference", "desired"}
"""Words for what a servo is to reach; they say as little as a quantity for an actuator that is none."""
ORDERS = GOALS | {"cmd", "command", "ctrl", "control", "setpoint", "demand"}
"""Beside these a word of position or speed says what a servo is told, not what was measured."""
QUANTITIES = {
    "pwm",
    "duty",
    "torque",
    "effort",
    "voltage",
    "volt",
    "volts",
    "force",
    "tau",
    "thrust",
    "current",
    "amp",
    "amps",
    "ampere",
    "amperes",
}
"""Words for the input or output of an actuator: a command where nothing better is there."""
UNIT_OF_A_COMMAND = {"a", "v", "nm"}
"""Units of such quantities, which are letters of many other names."""
NO_COMMAND = {
    "temp",
    "temperature",
    "battery",
    "index",
    "idx",
    "seq",
    "sequence",
    "counter",
    "count",
    "row",
    "id",
    "status",
    "state",
    "flag",
    "mode",
}
"""Words of columns that are in many logs and tell no actuator anything."""
NAMED, SURE, LIKELY, CALLED = 6, 4, 2, 3
"""Weights of a column: it holds the name; a word of the kind; a quantity of a command; it is the actuator's name alone.

The last is less than a joint's claim by its name, and than a word for a command.
"""
UNITS = {word: word for word in ("mm", "cm", "um", "deg", "rev", "mrad", "rpm")} | {"degrees": "deg", "degree": "deg"}
OF_KIND = {"qpos": {"mm", "cm", "um", "deg", "rev", "mrad"}, "qvel": {"rpm"}}
CLOCK = {"time", "t", "timestamp", "stamp", "clock", "elapsed", "since", "start"}
SECONDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "millis", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "usec", "micros", "microsecond", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nanos", "nanosecond", "nanoseconds"), "ns"),
}
OF_PUSHES = ("N", "N m", "V", "A")
"""SI units of what an actuator is told that is no servo."""
OF_POSITIONS = OF_KIND["qpos"] | {"m", "rad"}
UNKNOWN_UNITS = {"counts", "ticks", "raw", "adc", "lsb", "grad", "gon"}
"""Words for numbers whose size in SI nobody can tell by the name."""
PER_SECOND = {unit for unit in OF_KIND["qpos"] if f"{unit}/s" in SI}


@dataclass(frozen=True)
class Match:
    """One of the model's names and the column proposed for it.

    Args:
        name: ``qpos.hinge``, ``ctrl.motor``, ``time``.
        column: of the log.
        unit: what the column's name says of its unit, as the problem file writes it; empty for SI.
        why: it was proposed.
    """

    name: str
    column: str
    unit: str = ""
    why: str = "proposed by its name"

    @property
    def exact(self) -> bool:
        """True if the match needs no line in the problem file."""
        return self.column == self.name and not self.unit


def match(names: Sequence[str], columns: Sequence[str], told: Mapping[str, str] | None = None) -> tuple[Match, ...]:
    """Columns for as many of the names as can be told; what one takes is no rival of the others.

    Args:
        names: of the model, ``<kind>.<joint or actuator>`` with kind qpos, qvel or ctrl.
        columns: of the log.
        told: see :func:`~onlinebayes.problems.drafting.servo_inputs.servo_inputs`.
    """
    told = told or {}
    found = [Match(name, name) for name in names if name in columns]
    left = [name for name in names if name not in columns]
    free = [column for column in columns if column not in names]
    scored = {(name, column): _score(name, column, names, told) for name in left for column in free}
    while more := _clear(left, free, scored, told):
        found += more
        left = [name for name in left if name not in {one.name for one in more}]
        free = [column for column in free if column not in {one.column for one in more}]
    return tuple(found)


def _clear(
    left: Sequence[str], free: Sequence[str], scored: Mapping[tuple[str, str], int], told: Mapping[str, str]
) -> list[Match]:
    """The names that one column fits best, which fits no other name as well."""
    found = []
    for name in left:
        best = max(((scored[name, column], column) for column in free), default=(0, ""))
        rivals = [other for other in free if other != best[1] and scored[name, other] == best[0]]
        claims = [other for other in left if other != name and scored[other, best[1]] >= best[0]] if best[0] else []
        if best[0] > 0 and not rivals and not claims:
            why = "a guess, it is the actuator's name alone" if best[0] == CALLED else Match.why
            found.append(Match(name, best[1], unit_of(told.get(name, name.partition(".")[0]), best[1]), why))
    return found


def could_be(
    name: str, names: Sequence[str], columns: Sequence[str], told: Mapping[str, str] | None = None
) -> tuple[str, ...]:
    """Columns of which each may be what ``name`` is measured or told by; one of them is a guess, several a question.

    Those that say most of it. Of a position that nothing names, all that say a position or its unit, and nothing else;
    of a command that nothing says anything of, all that do not say something else.

    Args:
        name: one that has no column.
        names: of the model.
        columns: that nothing takes.
        told: see :func:`~onlinebayes.problems.drafting.servo_inputs.servo_inputs`.
    """
    scores = {column: _score(name, column, names, told or {}) for column in columns}
    most = max(scores.values(), default=0)
    if most > 0:
        return tuple(column for column, score in scores.items() if score == most)
    kind = name.partition(".")[0]
    if kind == "qpos":
        others = set().union(NO_COMMAND, CLOCK, KINDS["qvel"], KINDS["ctrl"], GOALS, QUANTITIES)
        own = KINDS["qpos"] | OF_KIND["qpos"]
        return tuple(column for column in columns if (said := set(words(column))) & own and not said & others)
    if kind != "ctrl":
        return ()
    others = set().union(NO_COMMAND, CLOCK, *(KINDS[kind] for kind in KINDS if kind != "ctrl"))
    return tuple(column for column in columns if not others & set(words(column)))


def match_time(columns: Sequence[str]) -> Match | None:
    """The column that holds the clock, as ``time``; None where none is clear.

    A clock's name has words for time and for its unit, and no others: ``time``, ``t``, ``Timestamp [ms]``, ``millis``.
    """
    if "time" in columns:
        return Match("time", "time")
    clocks = [column for column in columns if (said := set(words(column))) and said <= CLOCK | SECONDS.keys()]
    if len(clocks) != 1:
        return None
    units = [SECONDS[word] for word in words(clocks[0]) if word in SECONDS]
    return Match("time", clocks[0], units[-1] if units else "")


def words(column: str) -> list[str]:
    """``LeftKneePos_deg`` -> ``["left", "knee", "pos", "deg"]``."""
    parts = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", column.replace("°", " deg "))
    return [part.lower() for part in parts]


def _is_rate(said: Sequence[str]) -> bool:
    """Check whether the words have the unit of a speed: ``rpm``, or a unit of a position before seconds (``deg_s``)."""
    return "rpm" in said or any(unit in OF_POSITIONS and SECONDS.get(of) == "s" for unit, of in pairwise(said))


def _has_foreign_unit(kind: str, column: str, said: Sequence[str]) -> bool:
    """Check whether the unit in a column's name is of another quantity, or one that cannot be turned into SI."""
    if kind == "qpos" and _is_rate(said):
        return True
    unread = kind == "qvel" and any(word in UNITS for word in said) and not unit_of(kind, column)
    return kind != "ctrl" and (unread or bool(UNKNOWN_UNITS & {*said}))


def _score(name: str, column: str, names: Sequence[str], told: Mapping[str, str]) -> int:
    """Score the agreement of a column with a name: 0 for none."""
    kind, _, target = name.partition(".")
    have, wanted = set(words(column)), set(words(target))
    means = KINDS | {"ctrl": KINDS["ctrl"] | GOALS | QUANTITIES}
    others = set().union(*(means[other] for other in means if other != kind)) - means[kind] - wanted
    aim = KINDS[told[name]] if name in told and have & ORDERS else set()
    named = wanted <= have
    beside = [word for word in words(column) if word not in wanted]
    if _has_foreign_unit(kind, column, beside):
        return 0
    said = _said(kind, beside, named, name in told) + bool(have & aim)
    only = sum(other.partition(".")[0] == kind for other in names) == 1
    if have & (others - aim) or not (named or (only and said)):
        return 0
    if not said and kind != "qpos":
        return CALLED if kind == "ctrl" and words(column) == words(target) else 0
    return NAMED * named + said


def _said(kind: str, beside: Sequence[str], named: bool, servo: bool) -> int:
    """Score how surely the words beside the name mean the kind: 0 for not at all."""
    have, rate = {*beside}, kind == "qvel" and _is_rate(beside)
    goal = kind == "ctrl" and bool(have & GOALS)
    if rate or have & KINDS[kind] or (goal and (servo or have & QUANTITIES)):
        return SURE
    likely = QUANTITIES | UNIT_OF_A_COMMAND if named else QUANTITIES
    return LIKELY if goal or (kind == "ctrl" and have & likely) else 0


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
    return said[-1] if said[-1] in OF_KIND[kind] else ""
