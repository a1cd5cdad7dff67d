"""The pose of a free joint: three columns for where it is, four for how it is turned, each named by its axis.

    pos_x, px, x, pose.position.x  ->  qpos.base.0         qw, quat_w, pose.orientation.w  ->  qpos.base.3

MuJoCo has w first, whatever the order of the columns: each part of a quaternion is mapped by its own name. Where
several poses are in the log, the one is taken that has the joint's name; where none has it, or several, none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from onlinebayes.problems.drafting.matching import Match, parts
from onlinebayes.problems.drafting.words import GOALS, KINDS, SILENT, words

PLACE = {"p", "pos", "position", "positions", "translation", "trans", "location", "loc", "xyz"}
TURN = {"q", "quat", "quaternion", "orientation", "ori", "rotation", "rot", "attitude", "att"}
BODIES = {"base", "body", "root", "torso", "trunk", "pelvis", "floating", "world", "pose", "link", "odom", "mocap"}
"""Words for what floats, and for where its pose comes from."""
PLACES, TURNS = ("x", "y", "z"), ("w", "x", "y", "z")
UNITS = {"m", "mm", "cm"}
WHY = "proposed by its name"
W_FIRST = "proposed by its name; w comes first, as MuJoCo has it"

Axes = dict[str, str]


def by_axes(names: Sequence[str], left: Sequence[str], columns: Sequence[str]) -> tuple[Match, ...]:
    """Columns for the poses of free joints, and for the turns of ball joints.

    Args:
        names: of the model.
        left: those without a column.
        columns: that nothing takes.
    """
    many = {joint: one for joint, one in parts(names).items() if joint.startswith("qpos.") and len(one) in (4, 7)}
    many = {joint: one for joint, one in many.items() if set(one) <= {*left}}
    places, turns = _axes(columns, PLACE, PLACES), _axes(columns, TURN, TURNS)
    found: list[Match] = []
    for joint, one in many.items():
        own = set(words(joint.partition(".")[2]))
        if len(one) == 7 and (place := _chosen(places, own, len(many))):
            found += _matches(one[:3], place, PLACES, WHY)
        if turn := _chosen(turns, own, len(many)):
            found += _matches(one[-4:], turn, TURNS, W_FIRST)
    return tuple(found)


def _matches(names: Sequence[str], found: Axes, axes: Sequence[str], why: str) -> list[Match]:
    units = {axis: next((word for word in words(found[axis]) if word in UNITS - {"m"}), "") for axis in axes}
    return [Match(name, found[axis], units[axis], why) for name, axis in zip(names, axes, strict=True)]


def _axes(columns: Sequence[str], means: set[str], axes: Sequence[str]) -> Mapping[frozenset[str], Axes]:
    """Complete sets of columns, one for each axis, by the words that they have beside what they mean."""
    found: dict[tuple[str, ...], Axes] = {}
    for column in columns:
        for axis, stem in _cut(words(column), axes):
            said = [word for word in stem if word not in UNITS]
            is_bare = axes == PLACES and not set(said) & (means | TURN)
            if set(said) & means or is_bare:
                found.setdefault(tuple(said), {}).setdefault(axis, column)
    whole = [(frozenset(said) - means - SILENT, one) for said, one in found.items() if len(one) == len(axes)]
    once: dict[frozenset[str], Axes] = {}
    for label, one in whole:
        once[label] = {} if label in once else one
    return {label: one for label, one in once.items() if one}


def _cut(said: Sequence[str], axes: Sequence[str]) -> list[tuple[str, list[str]]]:
    """The axis that is a word of its own, or the end of a word of two letters (``px``, ``qw``), and all other words."""
    found = []
    for k, word in enumerate(said):
        rest = [*said[:k], *said[k + 1 :]]
        if word in axes:
            found.append((word, rest))
        elif len(word) == 2 and word[1] in axes and word[0] in ("p", "q"):
            found.append((word[1], [*said[:k], word[0], *said[k + 1 :]]))
    return found if len(found) == 1 else []


def _chosen(found: Mapping[frozenset[str], Axes], own: set[str], joints: int) -> Axes | None:
    """The set whose words are the joint's; without such a one the only one, where there is one such joint."""
    told = GOALS | KINDS["ctrl"]
    fitting = {label: one for label, one in found.items() if not label & told and label <= own | BODIES | PLACE}
    named = [one for label, one in fitting.items() if label & own]
    if len(named) == 1:
        return named[0]
    return next(iter(fitting.values())) if len(fitting) == 1 and joints == 1 and not named else None
