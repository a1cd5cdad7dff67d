"""What a hypothesis may add to a model: an effect, an effect of one size a run, or a number of the model freed.

Each says how it joins a simulator, and from which values a fit of it may begin.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

from onlinebayes.criticism.candidates.candidates import trials
from onlinebayes.identification.replaying.scoped import ScopedSimulator, effect_entries, unscoped
from onlinebayes.identification.scope import Scope
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.identifiable import Identifiable

DIFFERENCE = 1e-3
"""Of its range, by which a freed number is moved to see what it does."""

FARTHEST = 3.0
"""A linear prediction goes so many times as far as a finite starting value."""


@dataclass(frozen=True)
class Start:
    """Where a fit of an addition may begin.

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

    def starts(self, simulator: Identifiable) -> tuple[Start, ...]:
        """Of the simulator with it."""
        ...


@dataclass(frozen=True)
class AddedEffect:
    """An effect; ``per_run`` gives it one size in every run."""

    effect: Effect
    per_run: bool = False

    @property
    def key(self) -> str:
        """``name@target``, or ``name@target in each run``."""
        return f"{self.effect.key} in each run" if self.per_run else self.effect.key

    @property
    def rank(self) -> int:
        """See :class:`Addition`."""
        return 2 if self.per_run else 1

    def joined(self, simulator: Identifiable, runs: Sequence[str]) -> Identifiable:
        """The simulator with the effect."""
        if not self.per_run:
            return simulator.with_effect(self.effect)
        known = simulator.scope if isinstance(simulator, ScopedSimulator) else Scope()
        scope = replace(known, per_run=(*known.per_run, self.effect.key))
        return ScopedSimulator(unscoped(simulator).with_effect(self.effect), scope, runs)

    def starts(self, simulator: Identifiable) -> tuple[Start, ...]:
        """One for each starting value of the effect."""
        effect, first = self.effect, self.effect.magnitude
        bounds, neutral = effect.parameters[first], effect.neutral[first]
        entries = effect_entries(simulator, effect)
        found = []
        for trial in trials([effect]):
            ends = sorted(((bounds.low - neutral) / trial.reach, (bounds.high - neutral) / trial.reach))
            if effect.starts and len(trial.values) > 1:
                ends = [max(ends[0], -FARTHEST), min(ends[1], FARTHEST)]
            values = {entry: trial.values[name] for entry, name in entries.items()}
            sized = tuple(entry for entry, name in entries.items() if name == first)
            found.append(Start(values, sized, neutral, trial.reach, ends[0], ends[1]))
        return tuple(found)


@dataclass(frozen=True)
class FreedNumber:
    """One of the model's own numbers, fitted within bounds."""

    address: str
    bounds: Parameter

    @property
    def key(self) -> str:
        """Its address."""
        return self.address

    @property
    def rank(self) -> int:
        """See :class:`Addition`."""
        return 0

    def joined(self, simulator: Identifiable, runs: Sequence[str]) -> Identifiable:
        """The simulator with the number among its parameters."""
        return simulator.with_free(self.address, self.bounds)

    def starts(self, simulator: Identifiable) -> tuple[Start, ...]:
        """Beside the model's own value."""
        place = simulator.parameters.index(self.address)
        own, step = float(simulator.nominal[place]), DIFFERENCE * (self.bounds.high - self.bounds.low)
        reach = step if own + step <= self.bounds.high else -step
        low, high = sorted(((self.bounds.low - own) / reach, (self.bounds.high - own) / reach))
        return (Start({self.address: own + reach}, (self.address,), own, reach, low, high),)
