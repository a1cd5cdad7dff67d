"""Names that differ only in their numbers: ``actual_q_0`` to ``actual_q_5``, ``joint1`` to ``joint7``.

motor_state[3].q  ->  template (motor, state, #, q), number (3,)
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import product

from onlinebayes.problems.drafting.words import words

Number = tuple[int, ...]


@dataclass(frozen=True)
class Family:
    """Names with one template.

    Args:
        template: the words, ``#`` for a number.
        members: the numbers of each name -> the name.
    """

    template: tuple[str, ...]
    members: Mapping[Number, str]

    @property
    def said(self) -> list[str]:
        """The words without the numbers."""
        return [word for word in self.template if word != "#"]

    @property
    def ordered(self) -> tuple[str, ...]:
        """The names in the order of their numbers."""
        return tuple(self.members[key] for key in sorted(self.members))

    @property
    def is_whole(self) -> bool:
        """True if no number is left out, and the first is 0 or 1 wherever numbers differ."""
        sets = [sorted(set(column)) for column in zip(*self.members, strict=True)]
        runs = all(len(one) == 1 or one == [*range(one[0], one[0] + len(one))] for one in sets)
        grid = set(product(*sets)) == set(self.members)
        return runs and grid and all(one[0] in (0, 1) or (len(one) == 1 and len(self.members) > 1) for one in sets)

    @property
    def numbers(self) -> frozenset[int]:
        """The numbers, where only one place of the template has different ones; else none."""
        varying = [set(column) for column in zip(*self.members, strict=True) if len(set(column)) > 1]
        return frozenset(varying[0]) if len(varying) == 1 else frozenset()


def families(names: Iterable[str]) -> tuple[Family, ...]:
    """Every template with its names; a name whose numbers stand twice spoils its family, which is left out."""
    found: dict[tuple[str, ...], dict[Number, str]] = {}
    spoilt = set()
    for name in names:
        said = words(name)
        template = tuple("#" if word.isdigit() else word for word in said)
        key = tuple(int(word) for word in said if word.isdigit())
        if key:
            spoilt |= {template} if key in found.get(template, {}) else set()
            found.setdefault(template, {})[key] = name
    return tuple(Family(template, members) for template, members in found.items() if template not in spoilt)


def shifted(targets: Mapping[str, str], columns: Iterable[str]) -> frozenset[tuple[str, str]]:
    """Pairs of a name and a column whose numbers may not be read as one another's: ``q0`` to ``q6``, joints 1 to 7.

    Numbers are the same where a family of columns has some of the model's, or begins with the same one.

    Args:
        targets: name of the model -> what its joint or actuator is called.
        columns: of the log.
    """
    of_model = [family for family in families(targets.values()) if len(family.members) > 1]
    of_log = [family for family in families(columns) if len(family.members) > 1]
    pairs = set()
    for model, log in product(of_model, of_log):
        ours, theirs = model.numbers, log.numbers
        if not ours or not theirs or not set(model.said) <= set(log.said):
            continue
        if not (theirs <= ours or min(theirs) == min(ours)):
            names = [name for name, called in targets.items() if called in model.members.values()]
            pairs |= set(product(names, log.members.values()))
    return frozenset(pairs)
