"""Parameters that differ between runs: one value a run, or known constants of some runs.

    theta_r = A_r phi + c_r

phi is what is fitted, theta_r what the simulator gets in run r. Each row of A_r picks one entry of phi, or none where
c_r holds a constant:

| parameter        | phi                          | theta_r                                                     |
|------------------|------------------------------|-------------------------------------------------------------|
| shared           | ``address``                  | that entry                                                  |
| one value a run  | ``address[run r]`` a run     | its own entry; the mean of all for a run that has none      |
| one value a group| ``address[run glob]`` a group| the group's entry, in every run that the glob matches       |
| known in the run | none                         | the constant                                                |
| not fitted       | none                         | the constant where the run has one, else the model's own    |
"""

from __future__ import annotations

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
    """

    per_run: tuple[str, ...] = ()
    known: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    unfitted: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.per_run or self.known or self.unfitted)

    def owned(self, address: str) -> bool:
        """Check whether a parameter has one value a run."""
        return address in self.per_run or ("@" in address and address.rpartition(".")[0] in self.per_run)

    def owner(self, run: str) -> str:
        """The key of a run's own values: the glob of its group, or of the run it is a part of; else its name."""
        name = origin(run)
        return next((glob for glob in self.groups if name == glob or fnmatchcase(name, glob)), run)

    def owners_without(self, address: str, runs: Iterable[str]) -> tuple[str, ...]:
        """The owners of those runs in which nothing is known of an address."""
        return tuple(dict.fromkeys(self.owner(run) for run in runs if address not in self.constants(run)))

    def constants(self, run: str) -> dict[str, float]:
        """Return the known constants of a run, address -> value [SI]; a part of a run knows what the run does."""
        names = {run, origin(run)}
        return {
            address: value
            for pattern, values in self.known.items()
            if any(name == pattern or fnmatchcase(name, pattern) for name in names)
            for address, value in values.items()
        }

    def check(self, parameters: ParameterSpace, runs: Iterable[str]) -> None:
        """Raise :class:`BadInput` where the scope names what is not there, or a run knows two values of one address."""
        runs = tuple(runs)
        for pattern in (*self.known, *self.groups):
            if not any(run == pattern or fnmatchcase(run, pattern) for run in runs):
                raise BadInput(f"no run is called '{pattern}'", nearest(pattern, runs, listed=12))
        for run in runs:
            if len(mine := [glob for glob in self.groups if run == glob or fnmatchcase(run, glob)]) > 1:
                raise BadInput(f"run '{run}' is in the groups '{mine[0]}' and '{mine[1]}'", "let one glob match it")
            seen: dict[str, float] = {}
            for pattern, values in self.known.items():
                if run != pattern and not fnmatchcase(run, pattern):
                    continue
                for address, value in values.items():
                    if seen.setdefault(address, value) != value:
                        problem = f"run '{run}' has two values of '{address}', {seen[address]:g} and {value:g}"
                        raise BadInput(problem, "let each run be matched once")
        named = [*self.per_run, *self.unfitted, *(address for values in self.known.values() for address in values)]
        for address in named:
            # What belongs to an effect may belong to a candidate, which is not there yet.
            if "@" not in address and address not in parameters:
                raise BadInput(
                    f"'{address}' is no parameter of the simulator", nearest(address, parameters.names, listed=12)
                )


def own_name(address: str, run: str) -> str:
    """Name of one run's (or group's) own value, e.g. ``body.cart.mass[run heavy]``."""
    return f"{address}[run {run}]"


def address_of(name: str) -> str:
    """The simulator's address of an entry of phi."""
    return name.partition("[run ")[0]
