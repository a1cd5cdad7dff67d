"""The answer of ``check`` as frozen values; nothing in these classes computes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

FALSE_ALARMS = 0.01
"""Share of checks of an unchanged machine that say it changed, at most."""


@dataclass(frozen=True)
class Since:
    """The first stretch of the new logs in which the machine is another.

    Args:
        run: its run.
        time: where in the run it begins [s]; None where that is the run's begin.
        first: whether it is the first of all: the machine changed before these logs.
    """

    run: str
    time: float | None
    first: bool


@dataclass(frozen=True)
class Change:
    """One thing that is no longer as it was [``unit``].

    Args:
        key: address of a parameter, or of a number of the model, or ``name@target.parameter`` of an effect.
        unit: SI unit.
        before: value over the reference.
        after: value since then.
        sd: of the difference.
        low, high: 90 % interval of ``after``.
        since: from when on.
        p: probability that a check of an unchanged machine says as much, of this or any other change.
        alike: keys of other changes that would explain the same logs.
    """

    key: str
    unit: str
    before: float
    after: float
    sd: float
    low: float
    high: float
    since: Since
    p: float
    alike: tuple[str, ...] = ()


@dataclass(frozen=True)
class DriftPoint:
    """A parameter's value in one run, fitted there alone.

    Args:
        run: its name.
        reference: whether the model was fitted to it.
        value, sd: [the parameter's unit].
    """

    run: str
    reference: bool
    value: float
    sd: float


@dataclass(frozen=True)
class Drift:
    """A parameter run by run."""

    key: str
    unit: str
    points: tuple[DriftPoint, ...]


@dataclass(frozen=True)
class ErrorNow:
    """RMS of the mended model over windows, by signal [its unit].

    Args:
        reference: over the logs that it was fitted to.
        now: over the new ones.
        ratio: of the mean squares of all rows, new over reference, without what the changes explain.
        p: probability that an unchanged machine shows such a ratio.
    """

    reference: Mapping[str, float]
    now: Mapping[str, float]
    ratio: float
    p: float


@dataclass(frozen=True)
class Check:
    """New logs held against a refined model.

    Args:
        verdict: ``"holds"`` or ``"changed"``.
        changes: what changed, the one that explains most first; none where only the error rose.
        error: of the model.
        drifts: of what changed, or else of the model's parameters.
        units: signal -> unit.
        reference_runs, new_runs: their names.
        asked: how many different changes were looked for.
        notes: what else a reader should know, a sentence each.
    """

    verdict: Literal["holds", "changed"]
    changes: tuple[Change, ...]
    error: ErrorNow
    drifts: tuple[Drift, ...]
    units: Mapping[str, str]
    reference_runs: tuple[str, ...]
    new_runs: tuple[str, ...]
    asked: int
    notes: tuple[str, ...] = ()
