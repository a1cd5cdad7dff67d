"""The score of a column as one of the model's signals or commands, from what its name says.

    score = 100 (named + said + aim) - words that say nothing

named: how far the joint's (the actuator's) name is held. said: how surely the words beside it mean the kind. aim: one
where a command is of the very quantity that the actuator is told. 0 where the column is something else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from onlinebayes.problems.drafting.actuator_inputs import Input
from onlinebayes.problems.drafting.column_units import UNIT_WORDS, has_foreign_unit, is_rate
from onlinebayes.problems.drafting.words import QUANTITIES, SILENT, Said, ends_in_unit, said_by, words

IN_FULL, IN_SHORT, IN_PART = 6, 5, 3
"""Weights of a name: all its words; without those that all names share or that say nothing; one no other name has."""
SURE, LIKELY, CALLED = 4, 2, 3
"""Weights of a column: a word of the kind; a quantity of a command; it is the actuator's name alone.

The last is less than a joint's claim by its name, and than a word for a command.
"""
UNIT = 100
"""One of those weights in a score; more than the words of a column's name."""


@dataclass(frozen=True)
class Target:
    """One of the model's names as a column may call it.

    Args:
        name: ``qpos.left_knee``, ``ctrl.motor``.
        calls: words of the joint; of an actuator its own, then its joint's.
        short: the same without words that all names share or that say nothing; empty where only numbers are left.
        input: what the actuator is told; None of a signal.
        lone: True if it is the only one of its kind.
    """

    name: str
    calls: tuple[frozenset[str], ...]
    short: tuple[frozenset[str], ...]
    input: Input | None
    lone: bool

    @property
    def kind(self) -> str:
        """``qpos``, ``qvel`` or ``ctrl``."""
        return self.name.partition(".")[0]


@dataclass(frozen=True)
class Score:
    """How well a column fits a name: ``value``, 0 for not at all, and why it is no more than a guess, if it is."""

    value: int = 0
    guess: str = ""


def targets(names: Sequence[str], inputs: Mapping[str, Input]) -> tuple[Target, ...]:
    """The model's names with what columns may call them."""
    calls = {name: _calls(name, inputs.get(name)) for name in names}
    found = []
    for name in names:
        kind = name.partition(".")[0]
        others = [calls[other] for other in names if other.partition(".")[0] == kind]
        shared = [frozenset.intersection(*(one[min(k, len(one) - 1)] for one in others)) for k in range(2)]
        drop = [SILENT | (words_ if len(others) > 1 else frozenset()) for words_ in shared]
        short = tuple(_spelt(one - drop[k]) for k, one in enumerate(calls[name]))
        found.append(Target(name, calls[name], short, inputs.get(name), len(others) == 1))
    return tuple(found)


def score(target: Target, column: str, rivals: Sequence[Target]) -> Score:
    """Score a column as ``target``; ``rivals`` are all names of its kind, itself among them."""
    said = words(column)
    have, best = set(said), Score()
    for own, short in zip(target.calls, target.short, strict=True):
        beside = [word for word in said if word not in own]
        named, why = _named(have & own, own, short, said_by(beside, UNIT_WORDS).unknown, rivals)
        extra = sorted(have & own & QUANTITIES) if named == IN_PART else []
        found = _score(target, column, [*beside, *extra], named, own == target.calls[0])
        if found.value > best.value:
            best = Score(found.value, found.guess or why)
    return best


def said_of(target: Target, column: str, beside: Sequence[str], named: bool = True) -> int:
    """Score how surely the words beside a name mean the target's kind; 0 where they mean another one, or nothing."""
    said, kind = said_by(beside, UNIT_WORDS), target.kind
    if said.foreign or has_foreign_unit(kind, column, beside):
        return 0
    if kind == "qpos":
        return (
            0 if said.told or said.goal or said.push or said.speed else SURE * said.position or LIKELY * said.measured
        )
    rate = is_rate(beside)
    if kind == "qvel":
        return 0 if said.told or said.goal or said.push or said.position else SURE * (said.speed or rate)
    return _told(target.input, said, named and ends_in_unit(column)) if kind == "ctrl" else 0


def is_another(target: Target, column: str, beside: Sequence[str]) -> bool:
    """Check whether the words beside a joint's name say that the column is not its position."""
    said = said_by(beside, UNIT_WORDS)
    others = said.told or said.goal or said.push or said.speed or said.foreign
    return others or has_foreign_unit(target.kind, column, beside)


def _calls(name: str, given: Input | None) -> tuple[frozenset[str], ...]:
    own = frozenset(words(name.partition(".")[2]))
    joint = frozenset(words(given.joint)) if given else frozenset()
    return (own, joint) if joint and joint != own else (own,)


def _spelt(left: frozenset[str]) -> frozenset[str]:
    """The words, if one of them is no number."""
    return left if any(not word.isdigit() for word in left) else frozenset()


def _named(
    held: set[str], own: frozenset[str], short: frozenset[str], unknown: int, rivals: Sequence[Target]
) -> tuple[int, str]:
    """How far a column holds a name, and why that is a guess, if it is."""
    if own <= held:
        return IN_FULL, ""
    if unknown:
        return 0, ""
    if short and short <= held:
        return IN_SHORT, ""
    quantities = all(any(call & QUANTITIES for call in rival.calls) for rival in rivals)
    telling = {word for word in held - SILENT if not word.isdigit() and (quantities or word not in QUANTITIES)}
    claims = sum(any(telling <= call for call in rival.calls) for rival in rivals)
    if telling and claims == 1:
        return IN_PART, f"a guess, no other name of the model has '{' '.join(sorted(telling))}'"
    return 0, ""


def _score(target: Target, column: str, beside: Sequence[str], named: int, by_itself: bool) -> Score:
    """Score what stands beside a name; ``by_itself`` where that is the target's own and not its joint's."""
    kind, cost = target.kind, said_by(beside, UNIT_WORDS).unknown
    said = said_of(target, column, beside, bool(named))
    if kind == "qpos" and named > IN_PART and not said and not cost and not is_another(target, column, beside):
        return Score(UNIT * named)
    if kind == "ctrl" and named == IN_FULL and by_itself and not beside:
        return Score(UNIT * CALLED, "a guess, it is the actuator's name alone")
    if not said or not (named or target.lone):
        return Score()
    guess = "a guess, it says no more than that it was measured" if said == LIKELY and kind == "qpos" else ""
    return Score(UNIT * (named + said) - cost, guess if not named else "")


def _told(given: Input | None, said: Said, unit: bool) -> int:
    """Score the words beside an actuator's name as a command; ``unit`` where there is one of a push."""
    given = given or Input()
    aim = said.order and {"qpos": said.position, "qvel": said.speed}.get(given.told, False)
    moved = said.position or said.speed
    if (moved and not aim) or (said.measured and not said.order) or (said.push and not given.takes_pushes):
        return 0
    if said.told or (said.goal and (given.told or said.push)):
        return SURE + int(aim)
    likely = said.push or (unit and given.takes_pushes)
    return (LIKELY if said.goal or likely else 0) + int(aim)
