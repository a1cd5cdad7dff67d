"""Which names are right: a hidden effect as the library spells it, its equals, and what it is made of.

| name                            | of ``asymmetric_friction@j``                              |
|---------------------------------|-----------------------------------------------------------|
| its own and its partners'       | asymmetric_friction@j                                     |
| all parts of a composition      | dry_friction@j and constant_load@j, which are the same law |
| simpler ones that it contains   | dry_friction@j: right beside the others, too little alone |

An effect with axes is spelt with the axis that the rig moved it along, as criticism tries it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from envs.rigs import RIGS
from onlinebayes.simulators.effects import EFFECTS

COMPOSED: Mapping[str, tuple[str, ...]] = {"asymmetric_friction": ("dry_friction", "constant_load")}


@dataclass(frozen=True)
class Answer:
    """What counts as finding one hidden effect.

    Args:
        names: keys of which any is right alone.
        parts: for each law that it is made of, keys of which any is right; all laws together are right too.
        simpler: keys of effects that it contains.
    """

    names: frozenset[str]
    parts: tuple[frozenset[str], ...]
    simpler: frozenset[str]

    def found(self, accepted: Iterable[str]) -> bool:
        """Whether what was accepted holds the effect."""
        present = set(accepted)
        return bool(self.names & present) or (bool(self.parts) and all(part & present for part in self.parts))

    def admits(self, key: str) -> bool:
        """Whether a key is no false alarm."""
        return key in self.names | self.simpler or any(key in part for part in self.parts)


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
    """The right names of an effect hidden in a rig.

    Args:
        rig: its name; its list of effects that no input parts gives the partners.
        hidden: the effect as the library spells it.
    """
    name, _, target = hidden.partition("@")
    parts = tuple(equals(rig, f"{part}@{target}") for part in COMPOSED.get(name, ()))
    simpler = frozenset(f"{part}@{target}" for part in (EFFECTS[name].contains if name in EFFECTS else ()))
    return Answer(equals(rig, hidden), parts, simpler)


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
