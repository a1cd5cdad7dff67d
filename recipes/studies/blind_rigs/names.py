"""Rules for the right names: a hidden effect as the library spells it, its equals, and what it is made of.

| name                            | of ``asymmetric_friction@j``                              |
|---------------------------------|-----------------------------------------------------------|
| its own and its partners'       | asymmetric_friction@j                                     |
| all parts of a composition      | dry_friction@j and constant_load@j, which are the same law |
| simpler ones that it contains   | dry_friction@j: right beside the others, too little alone |

A number of the model is named by its address; what criticism names is taken as the law that it is.
An effect with axes is spelt with the axis that the rig moved it along, as criticism tries it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from envs.rigs import RIGS
from onlinebayes.criticism import same_as
from onlinebayes.simulators.effects import EFFECTS

COMPOSED: Mapping[str, tuple[str, ...]] = {"asymmetric_friction": ("dry_friction", "constant_load")}


@dataclass(frozen=True)
class Answer:
    """Rule for finding one hidden effect.

    Args:
        names: laws of which any is right alone.
        parts: for each law that it is made of, laws of which any is right; all together are right too.
        simpler: laws that it contains.
        rig: in which it hides; empty for a machine whose numbers are no other law than usual.
    """

    names: frozenset[str]
    parts: tuple[frozenset[str], ...]
    simpler: frozenset[str]
    rig: str = ""

    def named(self, key: str) -> bool:
        """Check whether a key is right alone."""
        return law(self.rig, key) in self.names

    def found(self, accepted: Iterable[str]) -> bool:
        """Check whether the accepted effects hold this one."""
        present = {law(self.rig, key) for key in accepted}
        return bool(self.names & present) or (bool(self.parts) and all(part & present for part in self.parts))

    def admits(self, key: str) -> bool:
        """Check whether a key is no false alarm."""
        named = law(self.rig, key)
        return named in self.names | self.simpler or any(named in part for part in self.parts)


def law(rig: str, key: str) -> str:
    """The effect that is the same law as a number of a rig's model; other keys as they are."""
    usual = same_as(key)
    return RIGS[rig].laws.get(key, usual) if rig else usual


def spelt(key: str, truth: Mapping[str, float]) -> str:
    """A rig's key as criticism spells it, e.g. ``com_offset@bob.x``."""
    name = key.split("@")[0]
    axes = EFFECTS[name].axes if name in EFFECTS else ()
    # The rigs' gravity turns towards +x.
    moved = [axis for axis in axes if f"{key}.{axis}" in truth] or list(axes[:1])
    return f"{key}.{moved[0]}" if moved else key


def address_of(entry: str, hidden: str, key: str) -> str:
    """The rig's address of a parameter that the library calls ``entry``, of the effect spelt ``hidden``."""
    return f"{key}.{entry.removeprefix(f'{hidden}.')}"


def answer(rig: str, hidden: str) -> Answer:
    """The right names of an effect hidden in a rig, or of a number of its model that is off.

    Args:
        rig: its name; its list of effects that no input parts gives the partners.
        hidden: the effect as the library spells it, or the number's address.
    """
    hidden = law(rig, hidden)
    name, _, target = hidden.partition("@")
    parts = tuple(equals(rig, f"{part}@{target}") for part in COMPOSED.get(name, ()))
    simpler = frozenset(f"{part}@{target}" for part in (EFFECTS[name].contains if name in EFFECTS else ()))
    return Answer(equals(rig, hidden), parts, simpler, rig)


def equals(rig: str, key: str) -> frozenset[str]:
    """The key and those that look like it on this rig, along every axis that they have."""
    alike = {key}
    for group in RIGS[rig].alike:
        if any(key == other or key.startswith(f"{other}.") for other in group):
            alike.update(spelling for other in group for spelling in spellings(other) if not key.startswith(other))
    return frozenset(alike)


def spellings(key: str) -> tuple[str, ...]:
    """A rig's key, and the same along each axis that the effect has."""
    name = key.split("@")[0]
    axes = EFFECTS[name].axes if name in EFFECTS else ()
    return (key, *(f"{key}.{axis}" for axis in axes))
