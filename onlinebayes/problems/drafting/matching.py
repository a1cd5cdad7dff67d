"""Columns of a log -> the model's signals and commands: exact names first, then names that say the same.

A column is cut into words (``LeftKneePos_deg`` -> left, knee, pos, deg; see :mod:`.words`). Of those beside the words
of a joint's name a position, a speed, a push or an order is read. Each pair of a name of the model and a column has a
score: how far the name is held (in full; without the words that all names share; a word that no other name has), how
surely the rest says the kind, less a little for every word that says nothing. What fits best on both sides is taken,
each column once, nothing by chance: a column that fits two names equally well is left out, until what it rivals is
taken. The clock's column is found by its name alone.

For a command a word of what was told (``cmd``, ``target``) counts more than one of what then flows or pushes
(``current``), which may be a measurement and is no command of a servo; beside it, a word of position or speed is no
other kind's where the actuator is told one; a unit alone (``coil_A``) counts beside the actuator's name. An actuator
answers to its joint's name, too.

What names leave is guessed, and called so: columns numbered in the model's order (:mod:`.numbered`), the pose of a free
joint (:mod:`.poses`), a servo's command as the twin of what was measured (:mod:`.twins`), a column with exactly an
actuator's name that no joint claims, and the one column left for the one actuator or joint left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from onlinebayes.problems.drafting.actuator_inputs import Input
from onlinebayes.problems.drafting.column_units import OF_KIND, unit_of
from onlinebayes.problems.drafting.families import shifted
from onlinebayes.problems.drafting.scoring import Score, Target, score, targets
from onlinebayes.problems.drafting.words import FOREIGN, GOALS, KINDS, NO_COMMAND, QUANTITIES, READINGS, words

CLOCK = {"time", "t", "timestamp", "stamp", "clock", "elapsed", "since", "start"}
SECONDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "millis", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "usec", "micros", "microsecond", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nanos", "nanosecond", "nanoseconds"), "ns"),
}


@dataclass(frozen=True)
class Match:
    """One of the model's names and the column proposed for it.

    Args:
        name: ``qpos.hinge``, ``ctrl.motor``, ``time``.
        column: of the log.
        unit: what the column's name says of its unit, as the problem file writes it; empty for SI.
        why: it was proposed.
        scale, offset: what makes SI of it where no unit does.
        unit_why: how unit, scale and offset were found.
    """

    name: str
    column: str
    unit: str = ""
    why: str = "proposed by its name"
    scale: float = 1.0
    offset: float = 0.0
    unit_why: str = "as the column's name says"

    @property
    def exact(self) -> bool:
        """True if the match needs no line in the problem file."""
        return self.column == self.name and not self.keys

    @property
    def keys(self) -> dict[str, str | float]:
        """``unit``, ``scale`` and ``offset`` of the problem file, where they are not as by default."""
        given: dict[str, str | float] = {"unit": self.unit} if self.unit else {}
        given |= {"scale": self.scale} if self.scale != 1.0 else {}
        return given | ({"offset": self.offset} if self.offset else {})


def match(names: Sequence[str], columns: Sequence[str], inputs: Mapping[str, Input] | None = None) -> tuple[Match, ...]:
    """Columns for as many of the names as can be told by words; what one takes is no rival of the others.

    Args:
        names: of the model, ``<kind>.<joint or actuator>`` with kind qpos, qvel or ctrl.
        columns: of the log.
        inputs: see :func:`~onlinebayes.problems.drafting.actuator_inputs.actuator_inputs`.
    """
    found = [Match(name, name) for name in names if name in columns]
    wanted = _by_words(names, inputs or {})
    left = [target for target in wanted if target.name not in columns]
    free = [column for column in columns if column not in names]
    scored = _scores(left, free, wanted)
    while more := _clear(left, free, scored):
        found += more
        left = [target for target in left if target.name not in {one.name for one in more}]
        free = [column for column in free if column not in {one.column for one in more}]
    return tuple(found)


def unit_as(name: str, column: str, inputs: Mapping[str, Input]) -> str:
    """The unit that a column's name says, as that of what a servo is told for a command."""
    told = inputs[name].told if name in inputs else ""
    return unit_of(told if told in OF_KIND else name.partition(".")[0], column)


def parts(names: Sequence[str]) -> dict[str, list[str]]:
    """``qpos.base`` -> ``qpos.base.0`` to ``.6``: the numbers of free and ball joints, which no word names."""
    found: dict[str, list[str]] = {}
    for name in names:
        joint, _, last = name.rpartition(".")
        if last.isdigit() and "." in joint:
            found.setdefault(joint, []).append(name)
    return {joint: many for joint, many in found.items() if many == [f"{joint}.{k}" for k in range(len(many))]}


def _by_words(names: Sequence[str], inputs: Mapping[str, Input]) -> list[Target]:
    numbered = {name for many in parts(names).values() for name in many}
    found = []
    for kind in dict.fromkeys(name.partition(".")[0] for name in names):
        one = [name for name in names if name.partition(".")[0] == kind]
        kept = targets([name for name in one if name not in numbered], inputs)
        found += [replace(target, lone=len(one) == 1) for target in kept]
    return found


def _scores(
    left: Sequence[Target], free: Sequence[str], wanted: Sequence[Target]
) -> dict[tuple[str, str], tuple[Score, str]]:
    """Each pair's score, and the unit that the column's name says."""
    found: dict[tuple[str, str], tuple[Score, str]] = {}
    for kind in dict.fromkeys(target.kind for target in left):
        rivals = [target for target in wanted if target.kind == kind]
        barred = shifted({target.name: target.name.partition(".")[2] for target in rivals}, free)
        for target in left:
            if target.kind != kind:
                continue
            given = {target.name: target.input} if target.input else {}
            for column in free:
                value = Score() if (target.name, column) in barred else score(target, column, rivals)
                found[target.name, column] = (value, unit_as(target.name, column, given) if value.value else "")
    return found


def _clear(
    left: Sequence[Target], free: Sequence[str], scored: Mapping[tuple[str, str], tuple[Score, str]]
) -> list[Match]:
    """The names that one column fits best, which fits no other name as well."""
    found = []
    for target in left:
        name = target.name
        best = max((scored[name, column][0].value for column in free), default=0)
        fitting = [column for column in free if best and scored[name, column][0].value == best]
        if len(fitting) != 1:
            continue
        others = (scored[other.name, fitting[0]][0].value for other in left if other is not target)
        if max(others, default=0) < best:
            chosen, unit = scored[name, fitting[0]]
            found.append(Match(name, fitting[0], unit, chosen.guess or Match.why))
    return found


def could_be(
    name: str, names: Sequence[str], columns: Sequence[str], inputs: Mapping[str, Input] | None = None
) -> tuple[str, ...]:
    """Columns of which each may be what ``name`` is measured or told by; one of them is a guess, several a question.

    Those that say most of it. Of a position that nothing names, all that say a position or its unit, and nothing else;
    of a command that nothing says anything of, all that do not say something else.

    Args:
        name: one that has no column.
        names: of the model.
        columns: that nothing takes.
        inputs: see :func:`~onlinebayes.problems.drafting.actuator_inputs.actuator_inputs`.
    """
    inputs, kind = inputs or {}, name.partition(".")[0]
    wanted = [target for target in _by_words(names, inputs) if target.kind == kind]
    for target in (one for one in wanted if one.name == name):
        scores = {column: score(target, column, wanted).value for column in columns}
        if (most := max(scores.values(), default=0)) > 0:
            return tuple(column for column, value in scores.items() if value == most)
    if kind == "qpos":
        others = set().union(NO_COMMAND, FOREIGN, CLOCK, KINDS["qvel"], KINDS["ctrl"], GOALS, QUANTITIES)
        own = KINDS["qpos"] | OF_KIND["qpos"] | READINGS
        return tuple(column for column in columns if (said := set(words(column))) & own and not said & others)
    if kind != "ctrl":
        return ()
    pushes = set() if name not in inputs or inputs[name].takes_pushes else QUANTITIES
    others = set().union(NO_COMMAND, FOREIGN, CLOCK, KINDS["qpos"], KINDS["qvel"], pushes)
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
