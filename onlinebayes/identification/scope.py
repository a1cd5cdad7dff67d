"""Parameters that differ between runs: one value a run or a unit, or known constants of some runs.

    theta_r = A_r phi + c_r

phi is what is fitted, theta_r what the simulator gets in run r. Each row of A_r picks one entry of phi, or none where
c_r holds a constant:

| parameter        | phi                          | theta_r                                                     |
|------------------|------------------------------|-------------------------------------------------------------|
| shared           | ``address``                  | that entry                                                  |
| one value a run  | ``address[run r]`` a run     | its own entry; the mean of all for a run that has none      |
| one value a group| ``address[run glob]`` a group| the group's entry, in every run that the glob matches       |
| one value a unit | ``address[unit name]`` a unit| the unit's entry, in every run of the unit                  |
| known in the run | none                         | the constant                                                |
| not fitted       | none                         | the constant where the run has one, else the model's own    |
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

from onlinebayes.identification.splitting import origin
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput, nearest


@dataclass(frozen=True)
class Scope:
    """The dependence of a simulator's parameters on the run.

    Args:
        per_run: addresses of the simulator's parameters, and keys ``name@target`` of effects (present or candidates,
            all of whose parameters are meant), that have one value in every run.
        known: name or glob of runs -> address -> value [SI] that is a known constant there.
        unfitted: addresses that are fitted in no run: where nothing is known the model's own value holds.
        groups: globs of runs that share what ``per_run`` names (runs of one specimen); the other runs stand alone.
        per_unit: as ``per_run``, with one value in each unit of the machine, of which :mod:`.fleet` says what the next
            unit's may be.
        units: name of a unit -> names or globs of its runs; the other runs are a unit each.
    """

    per_run: tuple[str, ...] = ()
    known: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    unfitted: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()
    per_unit: tuple[str, ...] = ()
    units: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.own or self.known or self.unfitted)

    @property
    def own(self) -> tuple[str, ...]:
        """What has one value in every run or unit."""
        return (*self.per_run, *self.per_unit)

    def owned(self, address: str) -> bool:
        """Check whether a parameter has one value a run or a unit."""
        return _names(self.own, address)

    def by_unit(self, address: str) -> bool:
        """Check whether a parameter has one value a unit."""
        return _names(self.per_unit, address) and not _names(self.per_run, address)

    def owner(self, address: str, run: str) -> str:
        """Which of an address's own values a run has: its unit's or its group's (a part of a run's); else its own."""
        name, shared = origin(run), self.units if self.by_unit(address) else {glob: (glob,) for glob in self.groups}
        return next((owner for owner, patterns in shared.items() if _matches(name, patterns)), run)

    def owners_without(self, address: str, runs: Iterable[str]) -> tuple[str, ...]:
        """The owners of those runs in which nothing is known of an address."""
        return tuple(dict.fromkeys(self.owner(address, run) for run in runs if address not in self.constants(run)))

    def entry(self, address: str, owner: str) -> str:
        """Name of an owner's value, e.g. ``body.cart.mass[run heavy]``, ``joint.knee.damping[unit third]``."""
        return f"{address}[{'unit' if self.by_unit(address) else 'run'} {owner}]"

    def constants(self, run: str) -> dict[str, float]:
        """Return the known constants of a run, address -> value [SI]; a part of a run knows what the run does."""
        names = {run, origin(run)}
        return {
            address: value
            for pattern, values in self.known.items()
            if any(_matches(name, (pattern,)) for name in names)
            for address, value in values.items()
        }

    def check(self, parameters: ParameterSpace, runs: Iterable[str]) -> None:
        """Raise :class:`BadInput` where the scope names what is not there, or a run knows two values of one address."""
        runs = tuple(runs)
        for pattern in (*self.known, *self.groups, *(one for patterns in self.units.values() for one in patterns)):
            if not any(_matches(run, (pattern,)) for run in runs):
                raise BadInput(f"no run is called '{pattern}'", nearest(pattern, runs, listed=12))
        for run in runs:
            if len(mine := [glob for glob in self.groups if _matches(run, (glob,))]) > 1:
                raise BadInput(f"run '{run}' is in the groups '{mine[0]}' and '{mine[1]}'", "let one glob match it")
            if len(mine := [unit for unit, patterns in self.units.items() if _matches(run, patterns)]) > 1:
                raise BadInput(f"run '{run}' is of the units '{mine[0]}' and '{mine[1]}'", "let one unit have it")
            seen: dict[str, float] = {}
            for pattern, values in self.known.items():
                if not _matches(run, (pattern,)):
                    continue
                for address, value in values.items():
                    if seen.setdefault(address, value) != value:
                        problem = f"run '{run}' has two values of '{address}', {seen[address]:g} and {value:g}"
                        raise BadInput(problem, "let each run be matched once")
        named = [*self.own, *self.unfitted, *(address for values in self.known.values() for address in values)]
        for address in named:
            # What belongs to an effect may belong to a candidate, which is not there yet.
            if "@" not in address and address not in parameters:
                raise BadInput(
                    f"'{address}' is no parameter of the simulator", nearest(address, parameters.names, listed=12)
                )

    def check_units(self, runs: Iterable[str]) -> None:
        """Raise :class:`BadInput` where the runs that are fitted are of fewer than two units.

        Args:
            runs: those that are fitted.
        """
        runs = tuple(runs)
        for address in self.per_unit:
            if len(found := self.owners_without(address, runs)) < 2:
                which = f"of one unit alone, '{found[0]}'" if found else "of no unit, for it is known in every run"
                raise BadInput(
                    f"'{address}' is per unit, and the runs that are fitted tell it {which}",
                    "name runs of two units or more, and hold out one run of a unit, not the unit; or let it be shared",
                )


def address_of(name: str) -> str:
    """The simulator's address of an entry of phi."""
    return _OWN.split(name, maxsplit=1)[0]


def unit_of(name: str) -> str:
    """The unit whose value an entry of phi is; empty for the others."""
    found = _OWN.search(name)
    return name[found.end() : -1] if found and found["kind"] == "unit" else ""


_OWN = re.compile(r"\[(?P<kind>run|unit) ")


def _names(keys: tuple[str, ...], address: str) -> bool:
    """Check whether an address, or the effect that it belongs to, is named."""
    return address in keys or ("@" in address and address.rpartition(".")[0] in keys)


def _matches(run: str, patterns: Iterable[str]) -> bool:
    return any(run == pattern or fnmatchcase(run, pattern) for pattern in patterns)
