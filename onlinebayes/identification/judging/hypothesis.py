"""Hypotheses of what is wrong with a model: each is the base model with some additions, as a comparable value.

A hypothesis holds no fitted value. :func:`build` makes the simulator that it stands for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from onlinebayes.identification.replaying.scoped import ScopedSimulator
from onlinebayes.simulators.identifiable import Identifiable


@dataclass(frozen=True)
class Start:
    """A point from which a fit of an addition may begin.

    Args:
        values: entries of the simulator's parameters -> value [SI].
        sized: the entries that say how much of it there is, one, or one a run.
        neutral: their value at which it is nothing [SI].
        reach: by how much ``values`` differ from it [SI].
        low, high: bounds of its size, in units of the reach.
    """

    values: Mapping[str, float]
    sized: tuple[str, ...]
    neutral: float
    reach: float
    low: float
    high: float


@runtime_checkable
class Addition(Protocol):
    """One addition; ``rank`` orders those that do equally well with equally many parameters, the lowest first."""

    @property
    def key(self) -> str:
        """Its name, unlike that of every other addition."""
        ...

    @property
    def rank(self) -> int:
        """Own numbers go before effects, these before effects of one size a run."""
        ...

    def joined(self, simulator: Identifiable, runs: Sequence[str]) -> Identifiable:
        """The simulator with it; raises :class:`BadInput` where it cannot carry it."""
        ...

    def starts(self, simulator: Identifiable, values: Mapping[str, float]) -> tuple[Start, ...]:
        """Of the simulator with it; ``values``: of the fitted model that it joins, by name [SI]."""
        ...


@dataclass(frozen=True)
class Hypothesis:
    """Additions to the base model, in the order in which they entered."""

    additions: tuple[Addition, ...] = ()

    @property
    def keys(self) -> tuple[str, ...]:
        """Of the additions."""
        return tuple(addition.key for addition in self.additions)

    def plus(self, addition: Addition) -> Hypothesis:
        """With one addition more."""
        return Hypothesis((*self.additions, addition))

    def minus(self, key: str) -> Hypothesis:
        """Without one of its additions."""
        return Hypothesis(tuple(addition for addition in self.additions if addition.key != key))

    def __str__(self) -> str:
        return " + ".join(self.keys) or "the model as it is"


def build(base: Identifiable, hypothesis: Hypothesis, runs: Sequence[str]) -> Identifiable:
    """The simulator of a hypothesis.

    Args:
        base: the model as the user gave it.
        hypothesis: what is added.
        runs: names of the fit runs, each of which gets own values where some differ by run.

    Raises:
        BadInput: the simulator cannot carry one of the additions.
    """
    simulator = ScopedSimulator(base.physics, base.scope, runs) if isinstance(base, ScopedSimulator) else base
    for addition in hypothesis.additions:
        simulator = addition.joined(simulator, runs)
    return simulator
