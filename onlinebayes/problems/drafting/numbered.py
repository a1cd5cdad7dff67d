"""Columns numbered in the model's order: ``actual_q_0`` to ``actual_q_5``, ``tau_J_d[0]``, ``motor_state[0].q``.

A family of columns (:mod:`.families`) is proposed in order where its words say the kind and nothing of any joint, and
exactly one row of the model's names is as long: all joints; those with an actuator; those whose own names are numbered;
all numbers of the model's positions; those of one free joint. It is a guess: nobody said that both orders are one.
Where several families say as much, none is taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from onlinebayes.problems.drafting.actuator_inputs import Input
from onlinebayes.problems.drafting.families import Family, families
from onlinebayes.problems.drafting.matching import Match, parts, unit_as
from onlinebayes.problems.drafting.scoring import LIKELY, Target, said_of
from onlinebayes.problems.drafting.words import said_by, words

WHY = "a guess, by order"
SYMBOLS = {"q", "qpos", "dq", "qd", "qvel"}
"""Of two families that say as much, the one with the symbol is the joint's own (``q``; ``theta`` is a motor's)."""

WHOLE_STATE = {"obs", "observation", "observed"}
"""Words for what was measured that are positions where there are as many: ``sensor_3`` may be anything."""


def by_order(
    names: Sequence[str], left: Sequence[str], columns: Sequence[str], inputs: Mapping[str, Input]
) -> tuple[Match, ...]:
    """Matches of whole rows of names with whole families of columns.

    Args:
        names: of the model.
        left: those without a column.
        columns: that nothing takes.
        inputs: see :func:`~onlinebayes.problems.drafting.actuator_inputs.actuator_inputs`.
    """
    found: list[Match] = []
    for kind in ("qpos", "qvel", "ctrl"):
        rows = [row for row in _rows(kind, names, inputs) if set(row[0]) <= {*left}]
        free = [column for column in columns if column not in {one.column for one in found}]
        best = _best(kind, rows, [one for one in families(free) if one.is_whole], inputs)
        if best is not None:
            row, family = best
            pairs = zip(row, family.ordered, strict=True)
            found += [Match(name, column, unit_as(name, column, inputs), WHY) for name, column in pairs]
    return tuple(found)


def _rows(kind: str, names: Sequence[str], inputs: Mapping[str, Input]) -> list[tuple[tuple[str, ...], frozenset[str]]]:
    """Every row of names that columns may be numbered like, with words that the columns may have."""
    own = [name for name in names if name.partition(".")[0] == kind]
    if not own:
        return []
    many = parts(own)
    single = [name for name in own if all(name not in one for one in many.values())]
    called = {name: name.partition(".")[2] for name in single}
    shared = frozenset.intersection(*(frozenset(words(one)) for one in called.values())) if single else frozenset()
    driven = {given.joint for given in inputs.values() if given.joint}
    acts = [name for name in single if (inputs[name].joint if name in inputs else called[name] in driven)]
    rows = [(tuple(own), frozenset[str]()), (tuple(single), shared), (tuple(acts), shared)]
    rows += [(tuple(one), frozenset(words(joint.partition(".")[2]))) for joint, one in many.items()]
    back = {one: name for name, one in called.items()}
    numbered = [family for family in families(called.values()) if len(family.members) > 1]
    rows += [(tuple(back[one] for one in family.ordered), frozenset(family.said)) for family in numbered]
    return [row for row in rows if row[0]]


def _best(
    kind: str,
    rows: Sequence[tuple[tuple[str, ...], frozenset[str]]],
    known: Sequence[Family],
    inputs: Mapping[str, Input],
) -> tuple[tuple[str, ...], Family] | None:
    """The family that says most, with the only row of its length; None where several say as much."""
    scored: list[tuple[tuple[int, bool], tuple[str, ...], Family]] = []
    for family in known:
        fitting: dict[tuple[str, ...], frozenset[str]] = {}
        for row, words_ in rows:
            if len(row) == len(family.members):
                fitting[row] = fitting.get(row, frozenset()) | words_
        if len(fitting) != 1:
            continue
        ((row, allowed),) = fitting.items()
        beside = [word for word in family.said if not (word in allowed and said_by([word]).unknown)]
        value = min(said_of(_target(name, inputs), family.ordered[0], beside, named=False) for name in row)
        is_vague = kind == "qpos" and value == LIKELY and not WHOLE_STATE & {*family.said}
        if value and not is_vague and not said_by(beside).unknown:
            scored.append(((value, bool(SYMBOLS & {*family.said})), row, family))
    best = max((one[0] for one in scored), default=None)
    chosen = [one for one in scored if one[0] == best]
    return chosen[0][1:] if len(chosen) == 1 else None


def _target(name: str, inputs: Mapping[str, Input]) -> Target:
    return Target(name, (), (), inputs.get(name), False)
