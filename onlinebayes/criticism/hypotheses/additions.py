"""Additions of a hypothesis to a model: an effect, one of one size a run, a number freed, or a bound that is wider.

Each says how it joins a simulator, and from which values a fit of it may begin.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from onlinebayes.criticism.candidates.candidates import trials
from onlinebayes.identification.judging.hypothesis import Start
from onlinebayes.identification.replaying.scoped import ScopedSimulator, effect_entries, unscoped
from onlinebayes.identification.results import Estimate
from onlinebayes.identification.scope import Scope, address_of
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.identifiable import Identifiable

DIFFERENCE = 1e-3
"""Of its range, by which a freed number is moved to see what it does."""

IN_EACH_RUN = " in each run"
"""Ends the name of what has one value a run."""

WIDER = 10.0
"""Times the distance between its bounds by which a parameter may go beyond one of them."""

PASSIVE = (".damping", ".frictionloss", ".stiffness", ".armature")
"""Ends of the addresses of what a machine may have none of."""

ON_BOUND = 1e-6
"""Of the range, within which a fitted parameter lies on its bound."""

FARTHEST = 3.0
"""A linear prediction goes so many times as far as a finite starting value."""


@dataclass(frozen=True)
class AddedEffect:
    """An effect; ``per_run`` gives it one size in every run."""

    effect: Effect
    per_run: bool = False

    @property
    def key(self) -> str:
        """``name@target``, or ``name@target in each run``."""
        return f"{self.effect.key}{IN_EACH_RUN}" if self.per_run else self.effect.key

    @property
    def rank(self) -> int:
        """See :class:`Addition`."""
        return 2 if self.per_run else 1

    def joined(self, simulator: Identifiable, runs: Sequence[str]) -> Identifiable:
        """The simulator with the effect."""
        if not self.per_run:
            return simulator.with_effect(self.effect)
        return _with_own(simulator, self.effect.key, unscoped(simulator).with_effect(self.effect), runs)

    def size(self, parameters: Mapping[str, Estimate]) -> tuple[Estimate, float] | None:
        """Its size, and the one at which it is nothing; None where each run has one of its own.

        Args:
            parameters: of a fitted model, by name.
        """
        first = self.effect.magnitude
        size = parameters.get(f"{self.effect.key}.{first}")
        return None if size is None else (size, self.effect.neutral[first])

    def at_end(self, values: Mapping[str, float]) -> bool:
        """Check whether its fitted size is the largest that can be, in one run at least: no size explains the data.

        Args:
            values: of the fitted model, by name [SI].
        """
        first = self.effect.magnitude
        bounds, neutral = self.effect.parameters[first], self.effect.neutral[first]
        near = ON_BOUND * (bounds.high - bounds.low)
        ends = [end for end in (bounds.low, bounds.high) if abs(end - neutral) > near]
        entry = f"{self.effect.key}.{first}"
        sizes = [value for name, value in values.items() if address_of(name) == entry]
        return any(abs(size - end) <= near for size in sizes for end in ends)

    def starts(self, simulator: Identifiable, values: Mapping[str, float]) -> tuple[Start, ...]:
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

    def starts(self, simulator: Identifiable, values: Mapping[str, float]) -> tuple[Start, ...]:
        """One, beside the model's own value."""
        place = simulator.parameters.index(self.address)
        own, step = float(simulator.nominal[place]), DIFFERENCE * (self.bounds.high - self.bounds.low)
        reach = step if own + step <= self.bounds.high else -step
        low, high = sorted(((self.bounds.low - own) / reach, (self.bounds.high - own) / reach))
        return (Start({self.address: own + reach}, (self.address,), own, reach, low, high),)


@dataclass(frozen=True)
class OwnValues:
    """A free parameter with one value in every run, in place of one for all."""

    address: str

    @property
    def key(self) -> str:
        """``address in each run``."""
        return f"{self.address}{IN_EACH_RUN}"

    @property
    def rank(self) -> int:
        """See :class:`Addition`."""
        return 2

    def joined(self, simulator: Identifiable, runs: Sequence[str]) -> Identifiable:
        """The simulator with a value in every run."""
        return _with_own(simulator, self.address, unscoped(simulator), runs)

    def starts(self, simulator: Identifiable, values: Mapping[str, float]) -> tuple[Start, ...]:
        """All of them beside the value that was one for all."""
        own = tuple(name for name in simulator.parameters if address_of(name) == self.address)
        bounds, shared = simulator.parameters[own[0]], values[self.address]
        step = DIFFERENCE * (bounds.high - bounds.low)
        reach = step if shared + step <= bounds.high else -step
        low, high = sorted(((bounds.low - shared) / reach, (bounds.high - shared) / reach))
        return (Start(dict.fromkeys(own, shared + reach), own, shared, reach, low, high),)


@dataclass(frozen=True)
class WiderRange:
    """A parameter's bounds, and wider ones."""

    name: str
    before: Parameter
    after: Parameter

    def start(self) -> Start:
        """A little beyond the old bound."""
        before, after = self.before, self.after
        up = after.high > before.high
        bound, end = (before.high, after.high) if up else (before.low, after.low)
        step = DIFFERENCE * (before.high - before.low) * (1 if up else -1)
        return Start({self.name: bound + step}, (self.name,), bound, step, 0.0, (end - bound) / step)

    def used(self, values: Mapping[str, float]) -> bool:
        """Check whether a fitted model has a value outside the old bounds; ``values``: by name [SI]."""
        return not self.before.low <= values[self.name] <= self.before.high


@dataclass(frozen=True)
class WiderBounds:
    """Parameters whose fit lies on a bound, each with a wider one, all at once.

    One bound can hold the others back: torques, masses and frictions that grow by one factor leave the motion as it is.
    """

    ranges: tuple[WiderRange, ...]

    @property
    def key(self) -> str:
        """``bounds of`` their names."""
        return f"bounds of {' and '.join(one.name for one in self.ranges)}"

    @property
    def rank(self) -> int:
        """See :class:`Addition`."""
        return 0

    def joined(self, simulator: Identifiable, runs: Sequence[str]) -> Identifiable:
        """The simulator with the wider bounds."""
        for one in self.ranges:
            simulator = simulator.with_bounds(one.name, one.after)
        return simulator

    def starts(self, simulator: Identifiable, values: Mapping[str, float]) -> tuple[Start, ...]:
        """One for each, a little beyond its bound."""
        return tuple(one.start() for one in self.ranges)

    def used(self, values: Mapping[str, float]) -> WiderBounds:
        """Those that a fitted model needs, or all where it needs none; ``values``: by name [SI]."""
        return WiderBounds(tuple(one for one in self.ranges if one.used(values)) or self.ranges)


def wider_bounds(simulator: Simulator, values: Mapping[str, float]) -> tuple[WiderBounds, ...]:
    """The wider bounds of all parameters whose fitted value lies on a bound that may be another; none without.

    A bound at zero stays (friction, mass and time are never negative), a positive low one goes down to a tenth, or to
    nothing where the machine may lack what the number says. Constants of nature (``option.*``) stay: a free fall in air
    would ask for a weaker gravity.

    Args:
        simulator: a model.
        values: as fitted [SI].
    """
    found = []
    for name in simulator.parameters:
        before, value = simulator.parameters[name], values[name]
        width = before.high - before.low
        if name.startswith("option.") or "@" in name:
            continue
        if value >= before.high - ON_BOUND * width:
            found.append(WiderRange(name, before, replace(before, high=before.high + WIDER * width)))
        elif value <= before.low + ON_BOUND * width and before.low != 0:
            nothing = 0.0 if name.endswith(PASSIVE) else before.low / WIDER
            low = nothing if before.low > 0 else before.low - WIDER * width
            found.append(WiderRange(name, before, replace(before, low=low)))
    return (WiderBounds(tuple(found)),) if found else ()


def _with_own(simulator: Identifiable, key: str, physics: Identifiable, runs: Sequence[str]) -> ScopedSimulator:
    """The physics with one value a run of what ``key`` names, beside what has so already."""
    known = simulator.scope if isinstance(simulator, ScopedSimulator) else Scope()
    return ScopedSimulator(physics, replace(known, per_run=(*known.per_run, key)), runs)
